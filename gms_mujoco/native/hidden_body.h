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

// State of a hidden body. Its velocity is absolute, so that a jump of the joint's leaves it alone.
enum { kDeflection = 0, kVelocity = 1, kJointVelocity = 2, kHiddenState = 3 };

// The state after an interval, by `move` of the relative motion, and the torque over the body's inertia by `pull`.
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
  const Relative r = move(Relative{deflection, before - course.start}, course);
  next[kDeflection] = r.position;
  next[kVelocity] = r.velocity + m.velocity;
  // In a coarse step the torque at its end may be anywhere in a swing. The mean over the step keeps momentum, and an
  // implicit step with it cannot gain energy.
  if (course.coarse) return (before - next[kVelocity]) / m.duration;
  return pull(Relative{r.position, next[kVelocity] - m.velocity});  // as rounded, so that it stands still with the state
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_HIDDEN_BODY_H_
