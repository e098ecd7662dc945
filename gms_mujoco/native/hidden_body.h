// A body that no sensor sees, coupled to the joint through a spring and damper: exact motion over one interval.
#ifndef GMS_MUJOCO_NATIVE_HIDDEN_BODY_H_
#define GMS_MUJOCO_NATIVE_HIDDEN_BODY_H_

#include "effect.h"

namespace gms {

constexpr double kTurn = 6.283185307179586;

// Position and velocity of the body relative to the joint.
struct Relative {
  double position, velocity;
};

// What is left of a motion r'' + 2 zeta omega r' + omega^2 r = -a after a time.
class Swing {
 public:
  Swing(double omega, double zeta, double time) : omega_(omega), t_(time), decay_(zeta * omega * time) {
    const double square = (1 - zeta * zeta) * omega * omega * time * time;
    if (square > 1e-8) {
      const double x = std::sqrt(square), e = std::exp(-decay_);
      c_ = e * std::cos(x);
      s_ = e * std::sin(x) / x;
    } else if (square < -1e-8) {
      const double x = std::sqrt(-square), up = std::exp(x - decay_), down = std::exp(-x - decay_);
      c_ = 0.5 * (up + down);
      s_ = 0.5 * (up - down) / x;
    } else {
      const double e = std::exp(-decay_);
      c_ = e * (1 - square / 2);
      s_ = e * (1 - square / 6);
    }
  }

  // Where the body is then while the joint accelerates at a.
  Relative from(Relative r, double a) const {
    const double rest = -a / (omega_ * omega_), away = r.position - rest;
    return {rest + away * (c_ + decay_ * s_) + r.velocity * t_ * s_,
            r.velocity * (c_ - decay_ * s_) - omega_ * omega_ * t_ * s_ * away};
  }

 private:
  double omega_, t_, decay_;
  double c_, s_;  // e^-decay times cos(x) and sin(x)/x with x^2 = square, which is negative above critical damping
};

// The same without a spring, of r'' + lambda r' = -a.
class Coast {
 public:
  Coast(double lambda, double time) : t_(time) {
    const double x = lambda * time;
    left_ = x > 0 ? std::exp(-x) : 1;
    kept_ = x > 1e-3 ? -std::expm1(-x) / x : 1 - x / 2 * (1 - x / 3 * (1 - x / 4));
    lost_ = x > 1e-3 ? (1 - kept_) / x : 0.5 - x / 6 * (1 - x / 4 * (1 - x / 5));
  }

  Relative from(Relative r, double a) const {
    return {r.position + t_ * (kept_ * r.velocity - t_ * lost_ * a), left_ * r.velocity - t_ * kept_ * a};
  }

 private:
  double t_;
  double left_, kept_, lost_;  // e^-x, and means over the interval of that and of what it lacks of 1
};

// How the joint moves inside an interval: it sets out at `start` and accelerates evenly to the velocity at the end,
// covering the displacement. For a smooth motion that sampled velocities describe this is the trapezoidal rule. A
// semi-implicit Euler step is a jump of velocity at its beginning: then the body is kicked and drifts, which keeps
// its energy where a scheme without the jump would gain some in every step.
struct Course {
  double start, acceleration;
  bool coarse;  // a time step that is long for a coupling of that rate [1/s]
  Course(const Motion& m, double before, double rate)
      : start(set_out(m)),
        acceleration((m.velocity - start) / m.duration),
        coarse(rate * m.duration > 1 && jumps(m, before)) {}
};

constexpr double kFraction = 0.25;  // of 1/w, the longest stretch in which a contact or a turn is looked for once
constexpr int kMostStretches = 64;
constexpr int kMostTurns = 8;       // or contacts, in one stretch; more is chatter within rounding
constexpr double kInstant = 1e-12;  // of a stretch, within which the instant of one is found
constexpr int kMostLooks = 200;     // for it: every fourth halves what is left
constexpr double kStill = 1e-14;    // of the velocity of the joint: that of a body at rest, rounded

inline int stretches(double omega, double duration) {
  const double wanted = std::ceil(omega * duration / kFraction);
  return wanted < kMostStretches ? static_cast<int>(std::fmax(wanted, 1)) : kMostStretches;
}

// What is left, of what a body is within until it comes to be beyond that, and how fast it grows.
struct Left {
  double left, rate;
  bool beyond;
};

// The first instant within t at which a body is beyond, where `last` is what is left at its end: just after, by Newton's
// steps to either side of it, and by halves where they lead elsewhere.
template <class Look>
double until(double t, Left last, Look look) {
  const double least = kInstant * t;
  double inside = 0, outside = t, now = t;
  for (int i = 1; i <= kMostLooks && outside - inside > least; i++) {
    now += (now == inside ? 0.25 : -0.25) * least - last.left / last.rate;
    if (i % 4 == 0 || !(now > inside && now < outside)) now = 0.5 * (inside + outside);
    last = look(now);
    (last.beyond ? outside : inside) = now;
  }
  return outside;
}

// The motion over time t of a body with dry friction, behind a joint that sets out at velocity v and accelerates at a: it is
// slowed down as long as it moves one way, and rests where friction holds what pushes it.
//
// `coupling` has the motion without friction, stretch(r, a, t), what it pulls the joint by, pull(r), and how fast that grows
// while the body rests, tightens(r, a). `taken`, unless it is null, grows by the velocity that friction takes of the body.
template <class Coupling>
Relative rubbed(const Coupling& coupling, Relative r, double v, double a, double t, double slow, double* taken) {
  for (int turn = 0; turn < kMostTurns && t > 0; turn++) {
    const double speed = r.velocity + v, pull = coupling.pull(r);
    const bool still = std::fabs(speed) <= kStill * std::fabs(v), rests = still && std::fabs(pull) <= slow;
    const double way = rests ? 0 : std::copysign(1, still ? -pull : speed);
    const auto at = [&](double now) {
      return rests ? Relative{r.position - (v + 0.5 * a * now) * now, -(v + a * now)}
                   : coupling.stretch(r, a + way * slow, now);
    };
    // Of the friction that holds it, or of the velocity that it has.
    const auto left = [&](Relative end, double now) {
      const double pulled = coupling.pull(end), velocity = way * (end.velocity + v + a * now);
      if (!rests) return Left{velocity, -way * pulled - slow, velocity < 0};
      const double rate = -std::copysign(1, pulled) * coupling.tightens(end, a);
      return Left{slow - std::fabs(pulled), rate, std::fabs(pulled) > slow};
    };
    const Relative end = at(t);
    const Left last = left(end, t);
    const double passed = last.beyond ? until(t, last, [&](double now) { return left(at(now), now); }) : t;
    const Relative there = last.beyond ? at(passed) : end;
    if (taken != nullptr) {
      *taken += rests ? -passed / 6 * (pull + 4 * coupling.pull(at(0.5 * passed)) + coupling.pull(there))
                      : way * slow * passed;
    }
    r = there;
    v += a * passed;
    if (last.beyond) r.velocity = -v;
    t -= passed;
  }
  return r;
}

// State of a hidden body. Its velocity is absolute, so that a jump of the joint's leaves it alone.
enum { kDeflection = 0, kVelocity = 1, kJointVelocity = 2, kHiddenState = 3 };

// The state after an interval, by `move` of the relative motion, and the torque over the body's inertia by `pull`. `move`
// tells also what velocity dry friction took of the body in a coarse step.
template <class Move, class Pull>
double follow(const Motion& m, double omega, double zeta, const double* state, double* next, Move move, Pull pull) {
  const double deflection = state[kDeflection], before = state[kVelocity], joint_before = state[kJointVelocity];
  next[kJointVelocity] = m.velocity;
  if (!(m.duration > 0)) {  // the joint was given its velocity in no time (a start, a reset): the body comes along
    next[kDeflection] = deflection;
    next[kVelocity] = before + (m.velocity - joint_before);
    return pull(Relative{deflection, next[kVelocity] - m.velocity});
  }
  const Course course(m, joint_before, omega * (1 + 2 * zeta));
  double taken = 0;
  const Relative r = move(Relative{deflection, before - course.start}, course, taken);
  next[kDeflection] = r.position;
  next[kVelocity] = r.velocity + m.velocity;
  // In a coarse step the torque at its end may be anywhere in a swing. The mean over the step keeps momentum, and an
  // implicit step with it cannot gain energy.
  if (course.coarse) return (before - taken - next[kVelocity]) / m.duration;
  return pull(Relative{r.position, next[kVelocity] - m.velocity});  // as rounded, so that it stands still with the state
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_HIDDEN_BODY_H_
