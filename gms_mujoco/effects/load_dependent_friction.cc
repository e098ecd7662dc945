#include "effect.h"

namespace {

void modulate(const double* p, int, const gms::Motion& m, gms::Level& level) {
  const double factor = 1 + p[0] * std::fabs(m.load);
  level.forward *= factor;
  level.backward *= factor;
}

}  // namespace

extern const gms::Effect gms_effect_load_dependent_friction;
const gms::Effect gms_effect_load_dependent_friction = {
    "load_dependent_friction",
    "LoadDependentFriction",
    "friction",
    "Friction that grows with what the joint carries: the level of every friction law of the joint is multiplied by\n"
    "1 + c |L|, L being the normal load or the torque that a gear transmits (the signal `load` of a record; in MuJoCo\n"
    "the torque of the actuators on the joint).\n"
    "Source: load-dependent friction of robot joints, Bittencourt and Gunnarsson, ASME J. Dyn. Sys. Meas. Control\n"
    "134 (2012).",
    "The torque error follows the sign of velocity with a height that follows the load.",
    "The same runs under several loads, in both directions: the load has to differ at the same speed.",
    {{"coefficient", "1/(N m)", 0, 0, gms::kInfinity, false, true, "c"}},
    nullptr,
    nullptr,
    nullptr,
    modulate,
    nullptr,
};
