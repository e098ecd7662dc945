#include "effect.h"

namespace {

void modulate(const double* p, int, const gms::Motion& m, gms::Level& level) {
  const double factor = 1 + p[0] * std::exp(-m.time / p[2]);
  level.forward *= factor;
  level.backward *= factor;
  if (p[3] == 0) level.stiffens = false;
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double*, double*) {
  return -p[1] * m.velocity * std::exp(-m.time / p[2]);
}

}  // namespace

extern const gms::Effect gms_effect_thermal_drift;
const gms::Effect gms_effect_thermal_drift = {
    "thermal_drift",
    "ThermalDrift",
    "friction",
    "Friction that settles while the axis warms up: the level of every friction law of the joint is multiplied by\n"
    "1 + a exp(-t/tau), and a drag b exp(-t/tau) is added to the viscous one, t being the time stamp of the record: it\n"
    "begins near zero where the axis was cold. The other parameters describe the warm axis, so friction that grows from\n"
    "(1 + a) Fc to Fc has a < 0. Grease thins as it warms: in robot joints most of the change is in the drag.\n"
    "One time constant, no recovery at rest; a recorded temperature is not used.\n"
    "The stiffness of `gms`, `lugre` and `dahl` follows their level, or with s = 0 stays.\n"
    "Source: friction during warm-up, Carvalho Bittencourt and Axelsson, IEEE/ASME Trans. Mechatronics 19 (2014).",
    "The torque error follows the sign of velocity, or velocity, and fades, or grows to a plateau, with time.",
    "One motion repeated from a cold start for several minutes.",
    {{"amplitude", "1", 0, -0.95, gms::kInfinity, false, true, "a, part of the level that fades"},
     {"viscous", "N m s/rad", 0, -gms::kInfinity, gms::kInfinity, false, true, "b, viscous drag that fades"},
     {"time_constant", "s", gms::kUnset, 0.1, gms::kInfinity, false, true, "tau"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness fades with the level; 0: the level alone"}},
    nullptr,
    nullptr,
    nullptr,
    modulate,
    torque,
};
