#include "effect.h"

namespace {

enum { kLevel, kViscous, kStiffening, kDropping, kWhole };

void modulate(const double* p, int, const gms::Motion& m, const double*, gms::Level& level) {
  if (p[kWhole] > 1) {
    level.lean += p[kLevel];
  } else if (p[kWhole] > 0) {
    level.scale(1 + gms::sign(m.displacement) * p[kLevel], false, true, false);
  } else {
    level.forward *= 1 + p[kLevel];
    level.backward *= 1 - p[kLevel];
    if (p[kStiffening] == 0) level.stiffens = false;
    if (p[kDropping] == 0) level.drops = false;
  }
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double*, double*) {
  return -p[kViscous] * std::fabs(m.velocity);
}

}  // namespace

extern const gms::Effect gms_effect_asymmetric_friction;
const gms::Effect gms_effect_asymmetric_friction = {
    "asymmetric_friction",
    "AsymmetricFriction",
    "friction",
    "Friction that differs between the directions: the level of every friction law of the joint is multiplied by\n"
    "1 + a forward and 1 - a backward, and the viscous drag by a torque -b |v| (drag sigma + b forward, sigma - b\n"
    "backward). A constant difference that does not scale with the level is `torque_offset`. The contacts of `gms`,\n"
    "`lugre` and `dahl` are stronger as a whole, their stiffness with their level, or with s = 0 in their level alone. An\n"
    "element of `gms` that turns then drops to the level of the direction that it comes to, or with r = 0 carries its\n"
    "force over, as a spring with two yield limits does. What a contact holds is not changed by that; with w = 1 the torque\n"
    "of dry friction is multiplied instead, as many a simulation has it, and jumps where the motion turns, or with w = 2\n"
    "by the direction in which it acts, F (1 + a sgn F). Where the level does not depend on speed that with s = 0 is a\n"
    "constant torque, and so are `lugre` and `dahl` of exponent 1 with s = 1.\n"
    "Source: direction-dependent Coulomb and viscous coefficients, Armstrong-Helouvry, Dupont and Canudas de Wit,\n"
    "Automatica 30 (1994).",
    "The torque error has one value forward and another backward, and may lean with speed.",
    "Runs at several constant speeds in both directions over the same positions.",
    {{"level", "1", 0, -0.99, 0.99, false, true, "a, relative difference of the friction level"},
     {"viscous", "N m s/rad", 0.0, -gms::kInfinity, gms::kInfinity, false, true, "b, half the difference of the viscous drags"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness differs as the level does; 0: the level alone"},
     {"dropping", "1", 1, 0, 1, false, false, "r, 1: a force that turns drops to the new level; 0: it is carried over"},
     {"whole", "1", 0, 0, 2, false, false,
      "w, 1: the torque as a whole differs, by the sign of motion, or 2: by its own; 0: level and stiffness"}},
    nullptr,
    nullptr,
    nullptr,
    modulate,
    torque,
};
