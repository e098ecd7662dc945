#include "effect.h"

namespace {

void modulate(const double* p, int, const gms::Motion& m, const double*, gms::Level& level) {
  const double factor = 1 + p[0] * std::fabs(m.load);
  level.scale(factor, p[1] != 0, p[2] != 0, p[3] != 0);
}

}  // namespace

extern const gms::Effect gms_effect_load_dependent_friction;
const gms::Effect gms_effect_load_dependent_friction = {
    "load_dependent_friction",
    "LoadDependentFriction",
    "friction",
    "Friction that grows with what the joint carries: the level of every friction law of the joint is multiplied by\n"
    "1 + c |L|, L being the normal load, or the torque that a gear transmits to its link: that of the drive less what\n"
    "the rotor and friction take, or the same, what the link needs. It is the signal `load` of a record (of a robot's\n"
    "joint by inverse dynamics, the armature of the model being the rotor), where none is logged the torque of the\n"
    "drive, and in MuJoCo what actuators, friction and damping gave in the step before, less armature times\n"
    "acceleration.\n"
    "The stiffness of `gms`, `lugre` and `dahl` follows their level, or with s = 0 stays. What a contact holds at rest is\n"
    "not changed by either; with w = 1 the whole torque of friction is multiplied, that and with d = 1 the drag too, as\n"
    "many a simulation has it.\n"
    "Source: load-dependent friction of robot joints, Bittencourt and Gunnarsson, ASME J. Dyn. Sys. Meas. Control\n"
    "134 (2012).",
    "The torque error follows the sign of velocity with a height that follows the load.",
    "The same runs under several loads, in both directions: the load has to differ at the same speed.",
    {{"coefficient", "1/(N m)", 0, 0, gms::kInfinity, false, true, "c"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness grows with the level; 0: the level alone"},
     gms::kWholeTorque,
     gms::kWithDrag},
    nullptr,
    nullptr,
    nullptr,
    modulate,
    nullptr,
};
