#include "effect.h"

namespace {

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double*, double*) {
  return p[0] * std::sin(m.position + p[1]);
}

}  // namespace

extern const gms::Effect gms_effect_gravity;
const gms::Effect gms_effect_gravity = {
    "gravity",
    "Gravity",
    "mechanics",
    "Torque of an unbalanced mass, tau = A sin(q + phi), with A = m g r: once per revolution.\n"
    "The mass hangs, in stable balance, at q = pi - phi; a mass that hangs at q = 0 has phi = pi.\n"
    "For axes that MuJoCo does not model itself: a body with mass and a centre off the axis has it already.\n"
    "Source: the gravity term of any robot model, e.g. Siciliano et al., Robotics (2009), chapter 7.",
    "The torque error is one sine per revolution, the same in both directions and at every speed.",
    "Slow constant-velocity runs over a whole revolution in both directions.",
    {{"amplitude", "N m", 0, 0, gms::kInfinity, false, true, "A = m g r"},
     {"phase", "rad", 0, -gms::kInfinity, gms::kInfinity, false, true, "phi, at position zero"}},
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    torque,
};
