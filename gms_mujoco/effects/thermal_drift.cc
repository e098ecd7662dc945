#include "effect.h"

namespace {

int n_state(int) { return 1; }

// How much of the change is left after heat theta.
double left(const double* p, double time, double theta) { return std::exp(p[4] > 0 ? -theta : -time / p[2]); }

void modulate(const double* p, int, const gms::Motion& m, const double* state, gms::Level& level) {
  const double factor = 1 + p[0] * left(p, m.time, state[0]);
  level.forward *= factor;
  level.backward *= factor;
  if (p[3] == 0) level.stiffens = false;
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const double theta = state[0];
  next[0] = theta;
  if (p[4] > 0 && m.duration > 0) {  // exact at the mean speed of the interval
    const double rest = std::fabs(m.displacement) / (m.duration * p[4]);
    next[0] = rest + (theta - rest) * std::exp(-m.duration / p[2]);
  }
  return -p[1] * m.velocity * left(p, m.time, next[0]);
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
    "So heat comes with time alone, and goes on at rest. With a speed V > 0 it is friction's own: exp(-theta) stands for\n"
    "exp(-t/tau), where tau dtheta/dt = |v|/V - theta from 0 where the record begins, and the axis cools as it rests. V = 0,\n"
    "the default, is no unknown of a fit; any other value is. A recorded temperature is not used.\n"
    "The stiffness of `gms`, `lugre` and `dahl` follows their level, or with s = 0 stays.\n"
    "Source: friction during warm-up, Carvalho Bittencourt and Axelsson, IEEE/ASME Trans. Mechatronics 19 (2014).",
    "The torque error follows the sign of velocity, or velocity, and fades, or grows to a plateau, with time.",
    "One motion repeated from a cold start for several minutes.",
    {{"amplitude", "1", 0, -0.95, gms::kInfinity, false, true, "a, part of the level that fades"},
     {"viscous", "N m s/rad", 0, -gms::kInfinity, gms::kInfinity, false, true, "b, viscous drag that fades"},
     {"time_constant", "s", gms::kUnset, 0.1, gms::kInfinity, false, true, "tau"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness fades with the level; 0: the level alone"},
     {"speed", "rad/s", 0, 0, gms::kInfinity, false, true, "V, speed that in the long run heats to theta = 1; 0: time does"}},
    n_state,
    nullptr,
    nullptr,
    modulate,
    torque,
};
