// The friction of one joint: a list of effects over one state vector.
#ifndef GMS_MUJOCO_NATIVE_JOINT_H_
#define GMS_MUJOCO_NATIVE_JOINT_H_

#include <string>
#include <vector>

#include "backward_euler.h"
#include "effect.h"

namespace gms {

const Effect* find_effect(const std::string& name);  // null where the catalogue has none

// An explicit step of a joint is stable where (w h)^2 + 2 h sigma / J < 4, w being its frequency on the springs of
// its friction, and more accurate than an implicit one. Up to this value of h * slope / J we take it, which leaves room
// for the coupling between joints.
constexpr double kExplicitLimit = 2;

// Where a joint is at one instant.
struct Sample {
  double time, position, velocity;
  double load = 0, temperature = kRoom;
};

// State vector: the position and the time at which the state holds (NaN before the first sample), then the
// state of each effect in order. Anchoring the state on the position makes evaluation idempotent: repeated
// calls at one position change nothing, and a call at an intermediate stage sees the motion since the anchor.
class Joint {
 public:
  struct Use {
    const Effect* effect;
    int n;                  // elements
    std::vector<double> p;  // parameters in the order of the effect's table
    int state;              // offset into the state vector
  };

  Joint() = default;
  Joint(const Joint&) = delete;  // calls_ points into uses_
  Joint& operator=(const Joint&) = delete;

  static constexpr int kAnchor = 2;
  static constexpr int kMaxState = 512;

  void add(const Effect* effect, int n, const double* p);
  int n_state() const { return n_state_; }
  int n_memory() const { return n_memory_; }
  const std::vector<Use>& uses() const { return uses_; }

  void reset(double* state) const;
  // Sets the state before the first sample from unknowns in [-1, 1], for friction of what it holds there in either
  // direction; null: never moved.
  void begin(const double* unknown, const Sample& first, double* state) const;

  // Torque on the joint at `now`, given the state at the anchor. Writes the state at `now` to `next` (may be
  // null) and the torque of each effect to `parts` (may be null). `next` may be `state`.
  double torque(const Sample& now, const double* state, double* next, double* parts = nullptr) const {
    const Motion motion = since(now, state);
    return next ? torque_over(motion, state, next, parts) : torque_only(motion, state, parts);
  }
  double torque_over(const Motion& motion, const double* state, double* next, double* parts = nullptr) const {
    next[0] = motion.position;
    next[1] = motion.time;
    if (!plain_ || parts) return sum(motion, state, next, parts);
    static const Level plain;
    return plain_(only_.p, only_.n, motion, plain, state + only_.state, next + only_.state);
  }

  // The same for up to at_once() joints that are alike(), from state[j] to next[j], given how each has moved.
  static void torques(int count, const Joint* const* joints, const Motion* motion, const double* const* state,
                      double* const* next, double* torque);

  // Whether the other has the same effects and elements as far as is known: `liken` has been told of it.
  bool alike(const Joint& other) const { return kind_ == other.kind_; }
  void liken(const Joint& other);

  // Whether the other has the same friction.
  bool equal(const Joint& other) const;

  // As many as have room in a Together.
  int at_once() const { return at_once_; }

  // The same for up to kTogether joints with the same effects that move alike, each with parameters of its own.
  static void alternatives(int count, const Joint* const* joints, const Motion& motion, const double* const* state,
                           double* const* next, double* torque);

  // How a joint has moved from where its state holds to `now`.
  static Motion since(const Sample& now, const double* state) {
    Motion motion{now.position, 0, now.velocity, 0, now.time, now.load, now.temperature};
    if (!std::isnan(state[0])) {
      motion.displacement = now.position - state[0];
      motion.duration = now.time > state[1] ? now.time - state[1] : 0;
    }
    return motion;
  }

  // How it moves to the end of a step of length h from `now`, when the state holds, that ends with velocity v. Where that
  // is no displacement, `side` says from which side: +1 or -1.
  static Motion ahead(const Sample& now, const double* state, double h, double v, double side) {
    double moved = (std::isnan(state[0]) ? 0 : now.position - state[0]) + h * v;
    if (moved == 0 || (moved > 0) != (side > 0)) moved = side * kTiny;  // rounding at standstill
    return Motion{now.position + h * v, moved, v, h, now.time + h, now.load, now.temperature};
  }

  // Torque at the end of such a step.
  double torque_ahead(const Sample& now, const double* state, double h, double v, double side) const {
    return torque_only(ahead(now, state, h, v, side), state);
  }

  // Torque over a backward-Euler step of length h from `now`: see backward_euler.h.
  using Search = gms::Search;
  double implicit_torque(const Sample& now, const double* state, double h, double free_velocity, double gain,
                         Search* search = nullptr) const;

  // What modulates friction over an interval.
  Level level(const Motion& motion, const double* state) const;

  // Change of torque per change of velocity over a step of length h, k h + sigma [N m s/rad], the larger of that from
  // the virgin state and from the other end of its memory; very large for a static law.
  double slope(double h) const;

  // Whether an effect of it steepens: see Effect.
  bool steepens() const { return steepens_; }

  // Whether the torque depends on the load.
  bool reads_load() const;

 private:
  double slope_once(double h) const;
  void recall(const double* unknown, const Level& level, double* state) const;
  double torque_only(const Motion& motion, const double* state, double* parts = nullptr) const {
    double next[kMaxState];
    return torque_over(motion, state, next, parts);
  }
  double sum(const Motion& motion, const double* state, double* next, double* parts) const;

  struct Call {  // of a function of one effect
    const Effect* effect;
    const double* p;
    int n, state, use;
    bool friction;  // which may be multiplied as a whole

    double scaled(double torque, const Level& level) const {
      return !friction ? torque : (effect->n_state ? level.of(torque) : level.drag) * torque;
    }
  };

  static void torques_of(const Call& x, const double* const* p, int count, const Motion* motion, const Level* level,
                         const double* const* state, double* const* next, double* torque);
  GMS_APART static void sums(int count, const Joint* const* joints, const Motion* motion, const double* const* state,
                             double* const* next, double* total);

  std::vector<Use> uses_;
  std::vector<Call> modulators_, torques_;
  Call only_{};            // the one call of a joint that needs no other, as most do
  Law* plain_ = nullptr;  // and what it calls; null: there are several, or what modulates it
  int n_state_ = kAnchor;
  int n_memory_ = 0;
  int at_once_ = kTogether;
  bool steepens_ = false;
  const Joint* kind_ = this;  // one that has the same effects and elements
};

// What Joint::torques is asked for and what it answers, with room for a state of each joint. On the stack, which is in the
// cache whatever world is stepped.
struct Together {
  const Joint* joint[kTogether];
  Motion motion[kTogether];
  double *state[kTogether], *room[kTogether], torque[kTogether];
  double numbers[Joint::kMaxState];  // where room may be
};

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_JOINT_H_
