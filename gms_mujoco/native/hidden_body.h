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

// Where the body is after time t while the joint accelerates at a, from r'' + 2 zeta omega r' + omega^2 r = -a.
// omega = 0 is free flight.
inline Relative swing(Relative r, double a, double omega, double zeta, double t) {
  if (omega == 0) return {r.position + t * (r.velocity - 0.5 * t * a), r.velocity - t * a};
  const double decay = zeta * omega * t, square = (1 - zeta * zeta) * omega * omega * t * t;
  // c and s are e^-decay times cos(x) and sin(x)/x with x^2 = square, which is negative above critical damping.
  double c, s;
  if (square > 1e-8) {
    const double x = std::sqrt(square), e = std::exp(-decay);
    c = e * std::cos(x);
    s = e * std::sin(x) / x;
  } else if (square < -1e-8) {
    const double x = std::sqrt(-square), up = std::exp(x - decay), down = std::exp(-x - decay);
    c = 0.5 * (up + down);
    s = 0.5 * (up - down) / x;
  } else {
    const double e = std::exp(-decay);
    c = e * (1 - square / 2);
    s = e * (1 - square / 6);
  }
  const double rest = -a / (omega * omega), away = r.position - rest;
  return {rest + away * (c + decay * s) + r.velocity * t * s,
          r.velocity * (c - decay * s) - omega * omega * t * s * away};
}

// How the joint moves inside an interval: it sets out at `start` and accelerates evenly to the velocity at the end,
// covering the displacement. For a smooth motion that sampled velocities describe this is the trapezoidal rule. A
// semi-implicit Euler step is a jump of velocity at its beginning: then the body is kicked and drifts, which keeps
// its energy where a scheme without the jump would gain some in every step.
struct Course {
  double start, acceleration;
  explicit Course(const Motion& m)
      : start(2 * m.rate() - m.velocity), acceleration(m.duration > 0 ? (m.velocity - start) / m.duration : 0) {}
};

// State of a hidden body. Its velocity is absolute, so that a jump of the joint's leaves it alone.
enum { kDeflection = 0, kVelocity = 1, kJointVelocity = 2, kHiddenState = 3 };

// The joint was given another velocity in no time (a start, a reset): the body comes along.
inline void carry(const Motion& m, const double* state, double* next) {
  next[kDeflection] = state[kDeflection];
  next[kVelocity] = state[kVelocity] + (m.velocity - state[kJointVelocity]);
  next[kJointVelocity] = m.velocity;
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_HIDDEN_BODY_H_
