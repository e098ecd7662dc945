#include "effect.h"

namespace {

int n_state(int) { return 1; }  // friction on the moving side, positive along the last direction of motion
int n_memory(int) { return 1; }

void recall(const double* p, int, const double* unknown, double* state) { state[0] = unknown[0] * p[0]; }

double torque(const double* p, int, const gms::Motion& m, const gms::Level& level, const double* state,
              double* next) {
  const double direction = gms::sign(m.displacement);
  next[0] = direction == 0 ? state[0] : direction * p[0] * level.at(direction);
  return -next[0];
}

}  // namespace

extern const gms::Effect gms_effect_coulomb;
const gms::Effect gms_effect_coulomb = {
    "coulomb",
    "Coulomb",
    "friction",
    "Coulomb friction, F = sgn(v) Fc, a static map with a jump at zero velocity.\n"
    "The direction is that of the displacement over the interval and stays while the joint does not move. A level\n"
    "at rest above Fc is the business of `stribeck`.\n"
    "Source: Yoon and Trumper, Mechatronics 24 (2014), equation 1, first term.",
    "The torque error is a square wave that follows the sign of velocity.",
    "Slow constant-velocity runs in both directions.",
    {{"coulomb", "N m", 0, 0, gms::kInfinity, false, true, "Fc, level in either direction"}},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    nullptr,
    true,
};
