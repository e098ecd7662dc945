#include "effect.h"

namespace {

int n_state(int) { return 1; }  // friction on the moving side, positive along the last direction of motion
int n_memory(int) { return 1; }

void recall(const double* p, int, const double* unknown, double* state) { state[0] = unknown[0] * p[1]; }

// tanh(x), x >= 0: the same on every machine.
double grip(double x) {
  const double left = gms::decay(2 * x);
  return (1 - left) / (1 + left);
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level& level, const double* state,
              double* next) {
  if (p[4] > 0) {  // a function of the velocity of the moment, as viscous drag is
    next[0] = state[0];
    const double direction = gms::sign(m.velocity), share = grip(std::fabs(m.velocity) / p[4]);
    return -direction * share * level.at(direction) *
           gms::stribeck_level(m.velocity, p[0], p[1], p[2], p[3], p[5]);
  }
  const double direction = gms::sign(m.displacement);
  next[0] = direction == 0 ? state[0]
                           : direction * level.at(direction) * gms::stribeck_level(m, p[0], p[1], p[2], p[3], p[5]);
  return -next[0];
}

}  // namespace

extern const gms::Effect gms_effect_stribeck;
const gms::Effect gms_effect_stribeck = {
    "stribeck",
    "Stribeck",
    "friction",
    "Static and Coulomb friction joined by the Stribeck curve, F = sgn(v) (Fc + (Fs - Fc) exp(-|v/Vs|^delta)):\n"
    "a static map with a jump at zero velocity; with `viscous` beside it the five-parameter curve.\n"
    "The direction is that of the displacement over the interval and stays while the joint does not move.\n"
    "With a creep velocity V0 > 0, tanh(v/V0) stands for sgn(v), and below its level friction gives way instead of\n"
    "holding: a film of grease, or a simulator that smooths sgn(v).\n"
    "V0 = 0, the default, is no unknown of a fit; any other value, or none (NaN), is.\n"
    "With a tail t > 0 (1 + t |v/Vs|^delta)^(-1/t) stands for the exponential: of t = 1 and delta = 2, 1/(1 + (v/Vs)^2).\n"
    "Sources: Yoon and Trumper, Mechatronics 24 (2014), equation 1; for t, Hess and Soom, ASME J. Tribology 112 (1990).",
    "The torque error follows the sign of velocity and is largest at the lowest speeds.",
    "Constant-velocity runs at many speeds, the lowest well below the Stribeck velocity, in both directions.",
    {{"coulomb", "N m", 0, 0, gms::kInfinity, false, true, "Fc, level at high velocity"},
     {"static", "N m", 0, 0, gms::kInfinity, false, true, "Fs, level at zero velocity", false, "coulomb"},
     {"stribeck_velocity", "rad/s", gms::kUnset, 1e-12, gms::kInfinity, false, true, "Vs, velocity at which the level has weakened"},
     {"stribeck_exponent", "1", 1.0, 0.1, 10, false, false, "delta, shape of the weakening"},
     {"creep_velocity", "rad/s", 0, 0, gms::kInfinity, false, true, "V0, velocity about which friction gives way; 0: it holds"},
     gms::kStribeckTail},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    nullptr,
    true,
};
