#include "effect.h"

namespace {

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double*, double*) {
  return -p[0] * m.velocity * std::fabs(m.velocity);
}

}  // namespace

extern const gms::Effect gms_effect_quadratic_drag;
const gms::Effect gms_effect_quadratic_drag = {
    "quadratic_drag",
    "QuadraticDrag",
    "friction",
    "Drag that grows with the square of velocity, F = c v |v|: windage, churning lubricant.\n"
    "Source: the drag law of turbulent flow, e.g. Batchelor, An Introduction to Fluid Dynamics (1967).",
    "The torque error against velocity is a parabola that changes sign with velocity.",
    "Constant-velocity runs up to the highest speed in both directions.",
    {{"coefficient", "N m s^2/rad^2", 0, 0, gms::kInfinity, false, true, "c"}},
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    torque,
    nullptr,
    true,
};
