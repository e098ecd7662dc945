#include "effect.h"
#include "side.h"

namespace {

using gms::Level;
using gms::Motion;

enum { kForce = 0, kSlip = 1 };  // state of element i: force at 2 i, slip direction at 2 i + 1 (0: sticks)
enum { kCurve = 5, kSlipsBack = kCurve, kTail };  // parameters, behind those of the elements

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
inline double curve_of(const double* c, const Motion& m, double exponent, double tail) {
  return gms::stribeck_level(m, c[0], c[1], c[2], exponent, tail);
}
inline double curve_of(const double* c, const Motion& m) { return curve_of(c, m, c[3], c[kTail]); }
inline double left_of(const double* c, const Motion& m, double level) {
  return level > 0 ? gms::decay(c[4] * m.duration / level) : 0;
}

constexpr double kFar = 1e300;  // a level that nothing reaches

// What the elements of a joint need to know of an interval in which it has moved.
struct Way {
  double direction, distance;
  double along, against;  // multipliers of the level along the motion, and of what is carried against it
  double lowest;          // what is carried at most against it, at rest, of the fraction; below 0
  double gives_way;       // beyond what an element slips at once, of the fraction; below 0
  double kept;            // share that is left of what has slipped against it: its level falls at once
  double level, carried;  // the same at its speed, along the motion and against it
  double left;            // of a difference to that, what has not decayed

  void follow(double curve, double remains) {
    level = curve * along;
    carried = -curve * against;
    left = remains;
  }
  // Where no element comes near a limit, as if there were none.
  void hold() {
    level = kFar;
    carried = lowest = -kFar;
  }
};

// But for what the Stribeck curve says, which is dear.
inline Way way_of(const double* p, int n, const Motion& m, const Level& at) {
  const bool back = m.displacement < 0;
  const double scale = back ? at.backward : at.forward, other = back ? at.forward : at.backward;
  // Against the motion counts what the other direction has left, where that is carried over a reversal.
  const double against = at.drops ? scale : other;
  const bool falls = at.drops && scale < other;  // in its level alone at once, as a whole where it gives way
  const double lowest = -p[2 * n + 1] * against;
  return {back ? -1.0 : 1.0, at.stiffness_at(m.displacement) * std::fabs(m.displacement), scale, against, lowest,
          falls && at.stiffens ? lowest : -kFar, falls && !at.stiffens ? scale / other : 1, 0, 0, 0};
}

constexpr int kBlock = 4;  // elements that are followed at once

// A number, or where compilers have them one for each of several elements.
template <int N>
struct Values {
  using Type = double;
};
#ifdef GMS_SIDE  // not of Warp's compilers
template <>
struct Values<gms::kSide> {
  using Type = gms::Side;
};
#endif

// Elements: they stick or slide at the level, of which `left` is what has not decayed over the interval. Without branches,
// so that one does not wait for another and nobody has to guess what it does. kBack: by the letter, whatever is beyond its
// level slips. kEven: friction is alike in both directions, and what can happen only where it is not is left out, to the
// same bit.
template <bool kBack, bool kEven, class T>
inline void follow(const Way& x, T stiffness, T fraction, T* force, T* slip) {
  // Forces here grow in the direction of motion.
  T before = x.direction * *force;
  if (!kEven) before *= *slip == -x.direction ? x.kept : 1.0;
  const T limit = fraction * x.level, carried = kEven ? -limit : fraction * x.carried;
  const T lowest = fraction * x.lowest, stuck = before + stiffness * x.distance, none = {};
  // An element that reaches its limit inside the interval slides at it for the rest. One that has slipped before, or that
  // the level has dropped below, keeps its force and relaxes. One that has reversed sticks again. What it carries from
  // before falls to what friction now lets it carry at rest and relaxes to what it would while sliding, and it sticks:
  // whether a limit that drops, with the speed or the load, overtakes a force that unwinds is a matter of noise and of
  // the step. Where it comes to a direction in which it is weaker as a whole it gives way instead.
  const auto goes_on = *slip == x.direction;
  auto slips = goes_on | (stuck > limit);
  T least = none;
  if (!kEven) {
    const auto gives_way = stuck < fraction * x.gives_way;
    slips |= gives_way;
    least = gives_way ? lowest - limit : none;
  }
  if (kBack) {
    const auto back = stuck < -limit;
    slips |= back;
    least = back ? -2 * limit : least;
  }
  const T beyond = before - limit, held = stuck < lowest ? lowest : stuck;
  const T over = goes_on | (beyond > least) ? beyond : least, under = held < carried ? held - carried : none;
  *force = x.direction * (slips ? limit + over * x.left : held - under * (1 - x.left));
  *slip = slips ? x.direction : 0.0;
}

// N elements. What is read is read before anything is written, so that `state` and `next` may be the same. Returns `total`
// with their torques.
template <int N, bool kBack, bool kEven>
inline double block(const double* __restrict stiffness, const double* __restrict fraction, const Way& x,
                    const double* state, double* next, double total) {
  using T = typename Values<N>::Type;
  constexpr int kSize = sizeof(T) / sizeof(double);
  double force[N], slip[N];
  for (int i = 0; i < N; i++) {
    force[i] = state[2 * i + kForce];
    slip[i] = state[2 * i + kSlip];
  }
  for (int i = 0; i < N; i += kSize) {
    follow<kBack, kEven, T>(x, *reinterpret_cast<const T*>(stiffness + i), *reinterpret_cast<const T*>(fraction + i),
                            reinterpret_cast<T*>(force + i), reinterpret_cast<T*>(slip + i));
  }
  for (int i = 0; i < N; i++) {
    next[2 * i + kForce] = force[i];
    next[2 * i + kSlip] = slip[i];
    total -= force[i];
  }
  return total;
}

// The same, as a call: merged into a loop over blocks they would be taken apart again.
template <int N, bool kBack, bool kEven>
GMS_APART double called(const double* stiffness, const double* fraction, const Way& x, const double* state, double* next,
                        double total) {
  return block<N, kBack, kEven>(stiffness, fraction, x, state, next, total);
}

template <bool kBack, bool kEven>
inline double moved(const double* p, int n, const Way& x, const double* state, double* next) {
  double total = 0;
  int i = 0;
  for (; i + kBlock <= n; i += kBlock) {
    total = called<kBlock, kBack, kEven>(p + i, p + n + i, x, state + 2 * i, next + 2 * i, total);
  }
  for (; i < n; i++) total = called<1, kBack, kEven>(p + i, p + n + i, x, state + 2 * i, next + 2 * i, total);
  return total;
}

inline double move(const double* p, int n, const Level& level, const Way& x, const double* state, double* next) {
  if (p[2 * n + kSlipsBack] > 0) return moved<true, false>(p, n, x, state, next);
  if (level.forward == level.backward) return moved<false, true>(p, n, x, state, next);
  return moved<false, false>(p, n, x, state, next);
}

// Four elements where nothing modulates friction.
GMS_APART double four(const double* p, const Motion& m, double curve, double left, const double* state, double* next) {
  Way way = way_of(p, kBlock, m, Level());
  way.follow(curve, left);
  return block<kBlock, false, true>(p, p + kBlock, way, state, next, 0);
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
    const double *from = state[j] + at, *c = p[j] + 2 * n;
    double* to = next[j] + at;
    if (m[j].displacement == 0) {
      out[j] = keep(n, from, to);
    } else if (kPlain && n == kBlock && !(c[kSlipsBack] > 0)) {
      out[j] = four(p[j], m[j], curve[j], left[j], from, to);
    } else {
      Way way = way_of(p[j], n, m[j], of(j));
      way.follow(curve[j], left[j]);
      out[j] = move(p[j], n, of(j), way, from, to);
    }
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
    for (int i = 0; known[j] && i < kCurve; i++) known[j] = p[j][2 * n + i] == p[j - 1][2 * n + i];
    known[j] = known[j] && p[j][2 * n + kTail] == p[j - 1][2 * n + kTail];
  }
  double curve[gms::kTogether], left[gms::kTogether];
  for (int j = 0; j < count; j++) curve[j] = known[j] ? curve[j - 1] : curve_of(p[j] + 2 * n, m);
  for (int j = 0; j < count; j++) left[j] = known[j] ? left[j - 1] : left_of(p[j] + 2 * n, m, curve[j] * way[j].along);
  for (int j = 0; j < count; j++) way[j].follow(curve[j], left[j]);
  for (int j = 0; j < count; j++) out[j] = move(p[j], n, level[j], way[j], state[j], next[j]);
}

// Whether an element does more than stick well below its limit: then it has to know the Stribeck curve, which is dear.
inline long long slides(const Way& x, double stiffness, double fraction, double most, double least, double force, double slip) {
  const double stuck = x.direction * force + stiffness * x.distance;
  const bool turns = (x.kept < 1) & (slip != 0);
  return (stuck > fraction * most) | (stuck < fraction * least) | (slip == x.direction) | turns;
}

// kUsual: four elements, a plain exponential curve, nothing that modulates friction: without a loop or a call.
template <bool kUsual>
inline double torque_of(const double* p, int any, const Motion& m, const Level& given, const double* state, double* next) {
  const int n = kUsual ? kBlock : any;
  const Level level = kUsual ? Level() : given;
  if (m.displacement == 0) return keep(n, state, next);
  Way way = way_of(p, n, m, level);
  const double most = p[2 * n] * way.along, least = -p[2 * n] * way.against;
  long long slide = 0;
  for (int i = 0; i < n; i++) {
    slide |= slides(way, p[i], p[n + i], most, least, state[2 * i + kForce], state[2 * i + kSlip]);
  }
  if (slide) {
    const double* c = p + 2 * n;
    const double curve = kUsual ? curve_of(c, m, 1, 0) : curve_of(c, m);
    way.follow(curve, left_of(c, m, curve * way.along));
  } else {
    way.hold();
  }
  return kUsual ? block<kBlock, false, true>(p, p + n, way, state, next, 0) : move(p, n, level, way, state, next);
}

double torque(const double* p, int n, const Motion& m, const Level& level, const double* state, double* next) {
  return torque_of<false>(p, n, m, level, state, next);
}

double usual(const double* p, int n, const Motion& m, const Level& level, const double* state, double* next) {
  return torque_of<true>(p, n, m, level, state, next);
}

gms::Law* plain(const double* p, int n) {
  const double* c = p + 2 * n;
  return n == kBlock && c[3] == 1 && !(c[kTail] > 0) && !(c[kSlipsBack] > 0) ? usual : torque;
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
    "With a tail t > 0 (1 + t |v/Vs|^delta)^(-1/t) stands for the exponential: of t = 1 and delta = 2, 1/(1 + (v/Vs)^2).\n"
    "The slip equation is integrated exactly over each interval, with s taken at its mean velocity.\n"
    "Sources: Lampaert, Al-Bender and Swevers, ICPA 2003; Yoon and Trumper, Mechatronics 24 (2014); for t, Hess and Soom,\n"
    "ASME J. Tribology 112 (1990).",
    "The torque error draws loops against position just after each reversal, and steps with the sign of velocity.",
    "Reversals at several amplitudes below and above the break-away distance, and slow constant-velocity runs.",
    {{"stiffness", "N m/rad", gms::kUnset, 0, gms::kInfinity, true, true, "k_i, spring of each element"},
     {"fraction", "1", 1.0, 0, 1, true, true, "alpha_i, share of each element in the level; they sum to 1", true},
     {"coulomb", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fc, level at high velocity"},
     {"static", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fs, level at zero velocity", false, "coulomb"},
     {"stribeck_velocity", "rad/s", gms::kUnset, 1e-12, gms::kInfinity, false, true, "Vs, velocity at which the level has weakened"},
     {"stribeck_exponent", "1", 1.0, 0.1, 10, false, false, "delta, shape of the weakening"},
     {"attraction", "N m/s", gms::kUnset, 0, gms::kInfinity, false, true, "C, rate at which a slipping element follows s(v)"},
     {"slips_back", "1", 0.0, 0, 1, false, false, "1: what unwinds slips back where a falling level overtakes it"},
     gms::kStribeckTail},
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
    plain,
};
