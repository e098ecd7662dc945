#include "effect.h"

namespace {

enum { kVelocity = 0, kAcceleration, kState };  // how the last interval ended

int n_state(int) { return kState; }

double torque(const double* p, int, const gms::Motion& m, const gms::Level& level, const double* state,
              double* next) {
  const double a = m.duration > 0 ? gms::acceleration(m, state[kVelocity]) : state[kAcceleration];
  const double share = (m.velocity + p[2] * a) / p[1];
  next[kVelocity] = m.velocity;
  next[kAcceleration] = a;
  return -std::fmin(std::fmax(share, -1.0), 1.0) * p[0] * level.at(share);
}

}  // namespace

extern const gms::Effect gms_effect_frictionloss;
const gms::Effect gms_effect_frictionloss = {
    "frictionloss",
    "Frictionloss",
    "friction",
    "Coulomb friction as MuJoCo's constraint `frictionloss` has it, soft and with inertia: below its level it is a\n"
    "damper and a mass, F = Fc clip((v + T dv/dt) / V0, -1, 1).\n"
    "Of a joint of inertia J, with d the impedance (solimpfriction's first two: d0 at rest, d1 at most) and t the time\n"
    "constant (solreffriction's first), T = t d1 / 2 and V0 = Fc T (1 - d0) / (d0 J): at MuJoCo's defaults T = 9.5 ms\n"
    "and V0 = 1.06 ms Fc / J. MuJoCo takes v from the beginning of a time step h, a fit to its motion finds T - h / 2.\n"
    "For motions that MuJoCo made; no bearing has it. Such a joint creeps under any load.\n"
    "Source: MuJoCo documentation, Computation, friction loss and solver parameters.",
    "The torque error lags behind the sign of velocity, and is largest where the joint should stand still.",
    "Reversals, and loads below the level: the joint creeps where others hold.",
    {{"coulomb", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fc, level in either direction"},
     {"creep_velocity", "rad/s", gms::kUnset, 1e-12, gms::kInfinity, false, true, "V0, velocity at which friction is at its level"},
     {"creep_time", "s", gms::kUnset, 0, gms::kInfinity, false, true, "T, by which friction is ahead of the velocity"}},
    n_state,
    nullptr,
    nullptr,
    nullptr,
    torque,
    nullptr,
    true,
    true,
};
