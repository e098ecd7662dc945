// The contract of a native effect: one physical cause of joint torque, one file in gms_mujoco/effects/.
//
// An effect file defines one constant `gms_effect_NAME`. CMake collects these into the catalogue; the MuJoCo
// plug-in, the replay along a measured motion, the axis simulation and the Python classes all come from it.
// Nothing else has to be edited to add an effect.
#ifndef GMS_MUJOCO_NATIVE_EFFECT_H_
#define GMS_MUJOCO_NATIVE_EFFECT_H_

#ifndef GMS_MUJOCO_KERNEL  // Warp compiles this file too: see gms_mujoco/kernel.py
#include <cmath>
#include <cstring>
#include <limits>
#endif

// Before a function that is not to be merged into its callers: what is called in every step, often for nothing, stays
// short. GMS_SELDOM: besides, it is called seldom. GMS_MERGED: always merged, since it would cost less than the call.
#if defined(GMS_MUJOCO_KERNEL)
#define GMS_APART inline
#define GMS_SELDOM
#define GMS_MERGED inline
#elif defined(_MSC_VER)
#define GMS_APART __declspec(noinline)
#define GMS_SELDOM __declspec(noinline)
#define GMS_MERGED __forceinline
#else
#define GMS_APART __attribute__((noinline))
#define GMS_SELDOM __attribute__((noinline, cold))
#define GMS_MERGED inline __attribute__((always_inline))
#endif

namespace gms {

#ifndef GMS_MUJOCO_KERNEL
constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
#endif
constexpr int kMaxParameters = 12;
constexpr int kTogether = 16;  // joints that an effect is asked for at once, at most
constexpr double kRoom = 20;   // [degC], where no temperature is known

// What the joint does over one interval, in SI units (rad and N m for a hinge, m and N for a slide).
struct Motion {
  double position;      // at the end of the interval
  double displacement;  // position at the end minus position at the beginning; 0 at the first instant
  double velocity;      // at the end of the interval
  double duration;      // length of the interval [s]; 0 at the first instant
  double time;          // at the end of the interval [s]
  double load;          // normal load or transmitted torque
  double temperature = kRoom;  // [degC]

  // Mean velocity over the interval; friction takes its direction and its Stribeck level from this.
  double rate() const { return duration > 0 ? displacement / duration : velocity; }
};

// Multipliers of the friction in each direction of motion. Effects that modulate friction (asymmetry, load,
// position, temperature) write them; every friction law scales by `at(direction)` what grows with the real area of
// contact: its level and, unless an effect says that the level alone changes, its pre-sliding stiffness. By `whole`, or
// `drag`, the joint multiplies the torque of each effect of kind "friction", which need not know of it.
struct Level {
  double forward = 1;
  double backward = 1;
  bool stiffens = true;  // whether the stiffness of a contact grows with its level
  bool drops = true;     // whether a contact that turns keeps no more than the level of the direction that it comes to
  double whole = 1;      // multiplier of the torque instead: of what contacts hold at rest, too
  double drag = 1;       // the same of what has no state, and so is no contact
  double lean = 0;       // of a contact: how much more torque it has where that resists forward, and less backward
  // By a factor in both directions, with the stiffness or without; or all of the torque, with the drag or without.
  void scale(double factor, bool with_stiffness, bool as_a_whole, bool with_drag = true) {
    if (as_a_whole) {
      whole *= factor;
      if (with_drag) drag *= factor;
      return;
    }
    forward *= factor;
    backward *= factor;
    if (!with_stiffness) stiffens = false;
  }
  // Multiplier of the torque of a contact, which it may depend on the sign of.
  double of(double torque) const { return whole * (1 - lean * ((torque > 0) - (torque < 0))); }
  double at(double direction) const { return direction < 0 ? backward : forward; }
  double stiffness_at(double direction) const { return stiffens ? at(direction) : 1; }  // multiplier of a stiffness
};

struct Parameter {
  const char* name;
  const char* unit;      // in hinge units; slide joints read m for rad and N for N m. What is in kg m^2 is a part of
                         // the axis's inertia that does not move with the joint
  double fallback;       // default value; 0 for a strength, with which the effect is absent; NaN: must be given or fitted
  double lower, upper;   // closed bounds
  bool per_element;      // one value per element instead of one for the effect
  bool free;             // identified by default
  const char* doc;
  bool share = false;    // the values of all elements sum to 1; the default is equal shares
  const char* at_least = nullptr;  // name of an earlier parameter that is a lower bound for this one
};

using Law = double(const double* p, int n, const Motion& motion, const Level& level, const double* state, double* next);

struct Effect {
  const char* name;        // the file's name
  const char* class_name;  // the Python class
  const char* kind;        // "friction", "drive" or "mechanics"
  const char* doc;         // equation and source
  const char* signature;   // what a person sees on a plot when the model lacks it
  const char* experiment;  // what to measure to bring it out
  Parameter parameters[kMaxParameters];  // ends at the first without a name

  // Number of doubles of state, and how many unknowns describe the state before the first sample.
  int (*n_state)(int n);
  int (*n_memory)(int n);

  // Sets `state` from unknowns in [-1, 1] (0: never moved), which have no unit or are positions; those of friction come
  // times what modulates its level in that direction. Null where there is no memory.
  void (*recall)(const double* p, int n, const double* unknown, double* state);

  // Scales the level of the joint's friction laws, given the effect's state where the interval begins. Null where the effect
  // does not modulate friction.
  void (*modulate)(const double* p, int n, const Motion& motion, const double* state, Level& level);

  // Torque on the joint [N m] at the end of the interval, and the state there. `next` may be `state`: what is read of it
  // is read before anything is written. With zero displacement and zero duration the state does not change, but that it
  // may take in the velocity: so it learns at the first sample what it sets out with. Null: no torque of its own.
  Law* torque;

  // Torques of the n elements, from the state that `torque` has written. Only where no element knows of the others, each
  // has one unknown of memory, and their torques add up to that of the effect; else null.
  void (*elements)(const double* state, int n, double* torque) = nullptr;

  // Whether everything it does turns round with the motion: of the motion and the state with the other sign, torque and
  // state with the other sign, whatever the parameters and wherever the joint stands. Of a periodic motion that is
  // alike in both directions half is then enough.
  bool turns_round = false;

  // Whether over one step it may change faster far from standstill than near it, as that of a body behind a gap does.
  bool steepens = false;

  // What `torque` gives, to the last bit, for up to kTogether joints, of which each has its parameters, motion, level and
  // states, from number `at` of theirs on: for speed alone. `level` is null where nothing modulates friction. Null: `torque`
  // is called for each.
  void (*torques)(const double* const* p, int n, int count, const Motion* motion, const Level* level, int at,
                  const double* const* state, double* const* next, double* torque) = nullptr;

  // The same for joints that move alike.
  void (*alternatives)(const double* const* p, int n, int count, const Motion& motion, const Level* level,
                       const double* const* state, double* const* next, double* torque) = nullptr;

  // The function that gives what `torque` does, to the last bit, where nothing modulates friction and the parameters are
  // these. Null: `torque` itself.
  Law* (*plain)(const double* p, int n) = nullptr;
};

// The parameters `p` of an effect with n elements lie in the order of its table, n values for one that is per
// element, else one. `n_state` and `n_memory` are null where there is none.

#ifndef GMS_MUJOCO_KERNEL
// For the tables of what has a Stribeck curve, see `weakened`.
constexpr Parameter kStribeckTail{
    "stribeck_tail", "1", 0, 0, 2, false, false, "t, how slowly the weakening ends; 0: as an exponential"};
// For the table of what multiplies friction by a factor, see `Level::scale`.
constexpr Parameter kWholeTorque{
    "whole", "1", 0, 0, 1, false, false, "w, 1: the torque of friction as a whole is multiplied; 0: level and stiffness"};
constexpr Parameter kWithDrag{"drag", "1", 1, 0, 1, false, false, "d, 1: with w = 1 drag is, too; 0: dry friction alone"};

extern const Effect* const kCatalogue[];
extern const int kCatalogueSize;
#endif

inline double sign(double x) { return (x > 0) - (x < 0); }

// The velocity with which a joint set out that has accelerated evenly over an interval.
inline double set_out(const Motion& m) { return 2 * m.rate() - m.velocity; }

// Whether an interval is a step of semi-implicit Euler, which jumps from the velocity `before` to its last one at once.
inline bool jumps(const Motion& m, double before) {
  return std::fabs(m.velocity - set_out(m)) <= 1e-3 * std::fabs(set_out(m) - before);
}

// Acceleration where an interval ends, of one that began with the velocity `before`: of the cubic through both ends; of
// one that jumps, and where rounding of the position leaves nothing of a cubic, the mean.
inline double acceleration(const Motion& m, double before) {
  constexpr double kRounding = 1e-14;  // of the position, with room
  const double change = m.velocity - before;
  const bool rounded = kRounding * std::fabs(m.position) > m.duration * std::fabs(change);
  return (rounded || jumps(m, before) ? change : 6 * (m.velocity - m.rate()) - 2 * change) / m.duration;
}

#ifdef GMS_MUJOCO_KERNEL
inline double decay(double x) { return std::exp(-x); }
#else
struct PowersOfHalf {
  static constexpr int kParts = 64;
  long long bits[kParts];
  PowersOfHalf() {
    for (int i = 0; i < kParts; i++) {
      const double value = std::exp2(-static_cast<double>(i) / kParts);
      std::memcpy(&bits[i], &value, sizeof value);
    }
  }
};
inline const PowersOfHalf kPowersOfHalf;

// e^-x for x >= 0 to a few units in the last place, the same on every machine, and in half the time of std::exp.
GMS_MERGED double decay(double x) {
  constexpr int n = PowersOfHalf::kParts;
  constexpr double ln2 = 0.6931471805599453;
  if (!(x < 700)) return x != x ? x : 0;
  const int k = static_cast<int>(x * (n / ln2) + 0.5);
  const double r = k * (ln2 / n) - x, r2 = r * r;  // |r| < 0.0055
  const double e = (1 + r) + r2 * ((0.5 + r * (1.0 / 6)) + r2 * (1.0 / 24 + r * (1.0 / 120)));
  const long long bits = kPowersOfHalf.bits[k & (n - 1)] - (static_cast<long long>(k >> 6) << 52);
  static_assert(n == 1 << 6, "a power of two");
  double power;
  std::memcpy(&power, &bits, sizeof power);
  return power * e;
}
#endif

GMS_SELDOM inline double power(double x, double exponent) { return std::pow(x, exponent); }

// Velocity-weakening part of the Stribeck curve, s(v) = Fc + (Fs - Fc) exp(-|v/Vs|^delta) (Yoon and Trumper
// 2014, equation 1, without its viscous term), at v / Vs; with a tail t > 0 (1 + t |v/Vs|^delta)^(-1/t) stands for the
// exponential, which it comes to as t does to 0, and of t = 1 and delta = 2 it is Hess and Soom's curve.
inline double weakened(double x, double coulomb, double static_level, double delta, double tail) {
  const double size = std::fabs(x), y = delta == 1 ? size : delta == 2 ? x * x : power(size, delta);
  const double left = !(tail > 0) ? decay(y) : tail == 1 ? 1 / (1 + y) : power(1 + tail * y, -1 / tail);
  return coulomb + (static_level - coulomb) * left;
}

inline double stribeck_level(double v, double coulomb, double static_level, double vs, double delta, double tail) {
  return static_level == coulomb ? coulomb : weakened(v / vs, coulomb, static_level, delta, tail);
}

// The same at the mean velocity of an interval, with one division for both.
inline double stribeck_level(const Motion& m, double coulomb, double static_level, double vs, double delta, double tail) {
  if (static_level == coulomb) return coulomb;
  const bool lasts = m.duration > 0;
  const double x = (lasts ? m.displacement : m.velocity) / (lasts ? m.duration * vs : vs);
  return weakened(x, coulomb, static_level, delta, tail);
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_EFFECT_H_
