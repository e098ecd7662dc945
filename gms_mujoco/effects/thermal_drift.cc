#include "effect.h"

namespace {

void modulate(const double* p, int, const gms::Motion& m, gms::Level& level) {
  const double factor = 1 + p[0] * std::exp(-m.time / p[1]);
  level.forward *= factor;
  level.backward *= factor;
  if (p[2] == 0) level.stiffens = false;
}

}  // namespace

extern const gms::Effect gms_effect_thermal_drift;
const gms::Effect gms_effect_thermal_drift = {
    "thermal_drift",
    "ThermalDrift",
    "friction",
    "Friction that settles while the axis warms up: the level of every friction law of the joint is multiplied by\n"
    "1 + a exp(-t/tau), t being the time stamp of the record: it begins near zero where the axis was cold. The other\n"
    "parameters describe the warm axis, so friction that grows from (1 + a) Fc to Fc has a < 0.\n"
    "One time constant, no recovery at rest; a recorded temperature is not used. Viscous drag is not a level: it stays.\n"
    "The stiffness of `gms` follows its level, or with s = 0 stays.\n"
    "Source: friction during warm-up, Carvalho Bittencourt and Axelsson, IEEE/ASME Trans. Mechatronics 19 (2014).",
    "The torque error follows the sign of velocity and fades, or grows to a plateau, with time.",
    "One motion repeated from a cold start for several minutes.",
    {{"amplitude", "1", 0, -0.95, gms::kInfinity, false, true, "a, part of the level that fades"},
     {"time_constant", "s", gms::kUnset, 0.1, gms::kInfinity, false, true, "tau"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness fades with the level; 0: the level alone"}},
    nullptr,
    nullptr,
    nullptr,
    modulate,
    nullptr,
};
