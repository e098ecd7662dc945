#include "effect.h"

namespace {

using gms::Level;
using gms::Motion;

enum { kForce = 0, kSlip = 1 };  // state of element i: force at 2 i, slip direction at 2 i + 1 (0: sticks)

int n_state(int n) { return 2 * n; }
int n_memory(int n) { return n; }

void recall(const double* p, int n, const double* unknown, double* state) {
  const double *fraction = p + n, level = std::fmax(p[2 * n], p[2 * n + 1]);
  for (int i = 0; i < n; i++) {
    state[2 * i + kForce] = unknown[i] * fraction[i] * level;
    state[2 * i + kSlip] = 0;
  }
}

double torque(const double* p, int n, const Motion& m, const Level& level, const double* state, double* next) {
  const double *stiffness = p, *fraction = p + n, *c = p + 2 * n;
  double total = 0;
  if (m.displacement == 0) {
    for (int i = 0; i < n; i++) {
      next[2 * i + kForce] = state[2 * i + kForce];
      next[2 * i + kSlip] = state[2 * i + kSlip];
      total += state[2 * i + kForce];
    }
    return -total;
  }
  const double direction = m.displacement < 0 ? -1 : 1, scale = level.at(direction);
  const double distance = (level.stiffens ? scale : 1) * std::fabs(m.displacement), least = c[0] * scale, most = c[1] * scale;
  // Forces here grow in the direction of motion. While every element sticks well below its limit nobody needs the
  // Stribeck curve, which is dear.
  int i = 0;
  for (; i < n; i++) {
    if (state[2 * i + kSlip] == direction) break;
    const double force = direction * state[2 * i + kForce] + stiffness[i] * distance;
    if (!(force <= fraction[i] * least && force >= -fraction[i] * most)) break;
    next[2 * i + kForce] = direction * force;
    next[2 * i + kSlip] = 0;
    total += force;
  }
  if (i == n) return -direction * total;

  const double s = gms::stribeck_level(m.rate(), c[0], c[1], c[2], c[3]) * scale;
  const double decay = s > 0 ? gms::decay(c[4] * m.duration / s) : 0;
  for (; i < n; i++) {
    const double limit = fraction[i] * s;
    double force = direction * state[2 * i + kForce], slip = direction;
    if (state[2 * i + kSlip] != direction) {  // it sticks, or has just reversed and sticks again
      const double stuck = force + stiffness[i] * distance, lowest = -fraction[i] * most;
      if (stuck < lowest) {  // what modulates friction no longer lets it carry its force: gives way
        force = lowest;
        if (!level.stiffens) slip = 0;  // a limit that has dropped is no slip in the direction of motion
      } else if (stuck > limit) {
        // An element that reaches its limit inside the interval slides at it for the rest; one that the level has
        // dropped below keeps its force and relaxes.
        if (force < limit) force = limit;
      } else {
        force = stuck;
        slip = 0;
      }
    }
    if (slip != 0) force = limit + (force - limit) * decay;
    next[2 * i + kForce] = direction * force;
    next[2 * i + kSlip] = slip;
    total += force;
  }
  return -direction * total;
}

double element(const double* state, int i) { return -state[2 * i + kForce]; }

}  // namespace

extern const gms::Effect gms_effect_gms;
const gms::Effect gms_effect_gms = {
    "gms",
    "GMS",
    "friction",
    "Generalized Maxwell-Slip friction: N massless elements in parallel, each a spring that slips.\n"
    "Sticking: dF_i/dt = k_i v until |F_i| reaches alpha_i s(v). Slipping: dF_i/dt = C (sgn(v) alpha_i - F_i/s(v)),\n"
    "sticking again when v changes sign, with s(v) = Fc + (Fs - Fc) exp(-|v/Vs|^delta).\n"
    "The slip equation is integrated exactly over each interval, with s taken at its mean velocity.\n"
    "Sources: Lampaert, Al-Bender and Swevers, ICPA 2003; Yoon and Trumper, Mechatronics 24 (2014).",
    "The torque error draws loops against position just after each reversal, and steps with the sign of velocity.",
    "Reversals at several amplitudes below and above the break-away distance, and slow constant-velocity runs.",
    {{"stiffness", "N m/rad", gms::kUnset, 0, gms::kInfinity, true, true, "k_i, spring of each element"},
     {"fraction", "1", 1.0, 0, 1, true, true, "alpha_i, share of each element in the level; they sum to 1", true},
     {"coulomb", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fc, level at high velocity"},
     {"static", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fs, level at zero velocity", false, "coulomb"},
     {"stribeck_velocity", "rad/s", gms::kUnset, 1e-12, gms::kInfinity, false, true, "Vs, velocity at which the level has weakened"},
     {"stribeck_exponent", "1", 1.0, 0.1, 10, false, false, "delta, shape of the weakening"},
     {"attraction", "N m/s", gms::kUnset, 0, gms::kInfinity, false, true, "C, rate at which a slipping element follows s(v)"}},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    element,
    true,
};
