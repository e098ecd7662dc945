#include "effect.h"

namespace {

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double*, double*) {
  return -p[0] * m.velocity;
}

}  // namespace

extern const gms::Effect gms_effect_viscous;
const gms::Effect gms_effect_viscous = {
    "viscous",
    "Viscous",
    "friction",
    "Viscous drag, F = sigma v (Yoon and Trumper 2014, last term of the Stribeck curve).",
    "The torque error is a straight line against velocity.",
    "Constant-velocity runs at several speeds in both directions.",
    {{"coefficient", "N m s/rad", 0, 0, gms::kInfinity, false, true, "sigma"}},
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    torque,
    nullptr,
    true,
};
