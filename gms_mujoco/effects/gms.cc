#include "effect.h"

namespace {

using gms::Level;
using gms::Motion;

enum { kForce = 0, kSlip = 1 };  // state of element i: force at 2 i, slip direction at 2 i + 1 (0: sticks)
enum { kCurve = 5, kSlipsBack = kCurve };  // parameters, behind those of the elements

int n_state(int n) { return 2 * n; }
int n_memory(int n) { return n; }

void recall(const double* p, int n, const double* unknown, double* state) {
  const double *fraction = p + n, level = std::fmax(p[2 * n], p[2 * n + 1]);
  for (int i = 0; i < n; i++) {
    state[2 * i + kForce] = unknown[i] * fraction[i] * level;
    state[2 * i + kSlip] = 0;
  }
}

// Where the joint has not moved nothing changes.
double keep(int n, const double* state, double* next) {
  double total = 0;
  for (int i = 0; i < n; i++) {
    next[2 * i + kForce] = state[2 * i + kForce];
    next[2 * i + kSlip] = state[2 * i + kSlip];
    total += state[2 * i + kForce];
  }
  return -total;
}

// The Stribeck curve and what is left of a difference to it, at the mean velocity of the interval.
inline double curve_of(const double* c, const Motion& m) { return gms::stribeck_level(m, c[0], c[1], c[2], c[3]); }
inline double left_of(const double* c, const Motion& m, double level) {
  return level > 0 ? gms::decay(c[4] * m.duration / level) : 0;
}

// What the elements of a joint need to know of an interval in which it has moved.
struct Way {
  double direction, distance;
  double along, against;  // multipliers of the level along the motion, and of what is carried against it
  double lowest;          // what is carried at most against it, at rest, of the fraction; below 0
  double kept;            // share that is left of what has slipped against it: its level falls at once
  bool gives_way;         // whether an element with more slips
  double level, carried;  // the same at its speed, along the motion and against it
  double left;            // of a difference to that, what has not decayed

  void follow(double curve, double remains) {
    level = curve * along;
    carried = -curve * against;
    left = remains;
  }
};

// But for what the Stribeck curve says, which is dear.
inline Way way_of(const double* p, int n, const Motion& m, const Level& at) {
  const bool back = m.displacement < 0;
  const double scale = back ? at.backward : at.forward, other = back ? at.forward : at.backward;
  // Against the motion counts what the other direction has left, where that is carried over a reversal.
  const double against = at.drops ? scale : other;
  const bool drops = at.drops && !at.stiffens;  // in its level alone
  return {back ? -1.0 : 1.0, (at.stiffens ? scale : 1) * std::fabs(m.displacement), scale, against,
          -p[2 * n + 1] * against, drops && scale < other ? scale / other : 1, at.stiffens && scale < other, 0, 0, 0};
}

// Each element sticks or slides at the level, of which `left` is what has not decayed over the interval. Without branches,
// so that compilers take several elements at a time, and nobody has to guess what an element does.
template <bool kBack>  // by the letter: whatever is beyond its level slips
inline double moved(const double* p, int n, const Way& way, const double* __restrict state, double* __restrict next) {
  const double *stiffness = p, *fraction = p + n;
  const Way x = way;  // `next` does not write into it
  for (int i = 0; i < n; i++) {
    // Forces here grow in the direction of motion.
    const double slip = state[2 * i + kSlip];
    const double before = x.direction * state[2 * i + kForce] * (slip == -x.direction ? x.kept : 1.0);
    const double limit = fraction[i] * x.level, carried = fraction[i] * x.carried;
    const double lowest = fraction[i] * x.lowest, stuck = before + stiffness[i] * x.distance;
    // An element that reaches its limit inside the interval slides at it for the rest. One that has slipped before, or that
    // the level has dropped below, keeps its force and relaxes. One that has reversed sticks again. What it carries from
    // before falls to what friction now lets it carry at rest and relaxes to what it would while sliding, and it sticks:
    // whether a limit that drops, with the speed or the load, overtakes a force that unwinds is a matter of noise and of
    // the step. Where it comes to a direction in which it is weaker as a whole it gives way instead.
    const bool goes_on = slip == x.direction, below = stuck < lowest;
    const bool back = kBack & (stuck < -limit);
    const bool slips = goes_on | back | (stuck > limit) | (x.gives_way & below);
    const double least = back ? -2 * limit : below ? lowest - limit : 0;
    const double beyond = before - limit, held = below ? lowest : stuck;
    const double over = goes_on | (beyond > least) ? beyond : least, under = held < carried ? held - carried : 0;
    next[2 * i + kForce] = x.direction * (slips ? limit + over * x.left : held - under * (1 - x.left));
    next[2 * i + kSlip] = slips ? x.direction : 0;
  }
  double total = 0;
  for (int i = 0; i < n; i++) total += next[2 * i + kForce];
  return -total;
}

inline double move(const double* p, int n, const Way& way, const double* state, double* next) {
  if (p[2 * n + kSlipsBack] > 0) return moved<true>(p, n, way, state, next);
  return moved<false>(p, n, way, state, next);
}

// What is dear first, for one joint after the other: nothing waits for the joint before, and nobody guesses what it does.
template <bool kPlain>  // nothing scales the level: compilers leave out all that would
inline void each(const double* const* p, int n, int count, const Motion* m, const Level* level, int at,
                 const double* const* state, double* const* next, double* out) {
  const auto of = [level](int j) { return kPlain ? Level() : level[j]; };
  double curve[gms::kTogether], left[gms::kTogether];
  for (int j = 0; j < count; j++) curve[j] = curve_of(p[j] + 2 * n, m[j]);
  for (int j = 0; j < count; j++) left[j] = left_of(p[j] + 2 * n, m[j], curve[j] * of(j).at(m[j].displacement));
  for (int j = 0; j < count; j++) {
    const double* from = state[j] + at;
    double* to = next[j] + at;
    Way way = way_of(p[j], n, m[j], of(j));
    way.follow(curve[j], left[j]);
    out[j] = m[j].displacement == 0 ? keep(n, from, to) : move(p[j], n, way, from, to);
  }
}

void torques(const double* const* p, int n, int count, const Motion* m, const Level* level, int at,
             const double* const* state, double* const* next, double* out) {
  (level ? each<false> : each<true>)(p, n, count, m, level, at, state, next, out);
}

// The same for joints that move alike. Those with one Stribeck curve, of which only the elements differ, share it.
void alternatives(const double* const* p, int n, int count, const Motion& m, const Level* level,
                  const double* const* state, double* const* next, double* out) {
  if (m.displacement == 0) {
    for (int j = 0; j < count; j++) out[j] = keep(n, state[j], next[j]);
    return;
  }
  Way way[gms::kTogether];
  bool known[gms::kTogether];  // from the joint before
  for (int j = 0; j < count; j++) {
    way[j] = way_of(p[j], n, m, level[j]);
    known[j] = j > 0 && level[j].at(m.displacement) == level[j - 1].at(m.displacement);
    for (int i = 2 * n; known[j] && i < 2 * n + kCurve; i++) known[j] = p[j][i] == p[j - 1][i];
  }
  double curve[gms::kTogether], left[gms::kTogether];
  for (int j = 0; j < count; j++) curve[j] = known[j] ? curve[j - 1] : curve_of(p[j] + 2 * n, m);
  for (int j = 0; j < count; j++) left[j] = known[j] ? left[j - 1] : left_of(p[j] + 2 * n, m, curve[j] * way[j].along);
  for (int j = 0; j < count; j++) way[j].follow(curve[j], left[j]);
  for (int j = 0; j < count; j++) out[j] = move(p[j], n, way[j], state[j], next[j]);
}

double torque(const double* p, int n, const Motion& m, const Level& level, const double* state, double* next) {
  if (m.displacement == 0) return keep(n, state, next);
  // While every element sticks well below its limit nobody needs the Stribeck curve, which is dear.
  const double *stiffness = p, *fraction = p + n;
  Way way = way_of(p, n, m, level);
  const double most = p[2 * n] * way.along, least = -p[2 * n] * way.against;
  double total = 0;
  for (int i = 0; i < n; i++) {
    const double force = way.direction * state[2 * i + kForce] + stiffness[i] * way.distance;
    const bool sticks = force <= fraction[i] * most && force >= fraction[i] * least;
    if (state[2 * i + kSlip] == way.direction || (way.kept < 1 && state[2 * i + kSlip] != 0) || !sticks) {
      const double curve = curve_of(p + 2 * n, m);
      way.follow(curve, left_of(p + 2 * n, m, curve * way.along));
      return move(p, n, way, state, next);
    }
    next[2 * i + kForce] = way.direction * force;
    next[2 * i + kSlip] = 0;
    total += force;
  }
  return -way.direction * total;
}

void elements(const double* state, int n, double* torque) {
  for (int i = 0; i < n; i++) torque[i] = -state[2 * i + kForce];
}

}  // namespace

extern const gms::Effect gms_effect_gms;
const gms::Effect gms_effect_gms = {
    "gms",
    "GMS",
    "friction",
    "Generalized Maxwell-Slip friction: N massless elements in parallel, each a spring that slips.\n"
    "Sticking: dF_i/dt = k_i v until |F_i| reaches alpha_i s(v). Slipping: dF_i/dt = C (sgn(v) alpha_i - F_i/s(v)),\n"
    "sticking again when v changes sign, with s(v) = Fc + (Fs - Fc) exp(-|v/Vs|^delta). Where the level drops, as the\n"
    "joint speeds up, what an element that unwinds has beyond it relaxes at the rate C too. By the letter of the law it\n"
    "slips back there, which `slips_back` asks for: so others simulate it, but it can then give more energy than it has\n"
    "stored, and the time step and noise decide whether it does.\n"
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
     {"attraction", "N m/s", gms::kUnset, 0, gms::kInfinity, false, true, "C, rate at which a slipping element follows s(v)"},
     {"slips_back", "1", 0.0, 0, 1, false, false, "1: what unwinds slips back where a falling level overtakes it"}},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    elements,
    true,
    false,
    torques,
    alternatives,
};
