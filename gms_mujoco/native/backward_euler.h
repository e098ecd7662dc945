// Backward Euler for the friction of one joint: the search for the velocity at the end of a step.
#ifndef GMS_MUJOCO_NATIVE_BACKWARD_EULER_H_
#define GMS_MUJOCO_NATIVE_BACKWARD_EULER_H_

#include <cmath>

namespace gms {

constexpr double kTiny = 1e-150;  // displacement that has a direction and nothing else

// What one search knows for the next at the same instant, with another free velocity.
struct Search {
  double forward = std::nan(""), backward = std::nan("");  // torque at the onset of motion either way
  double velocity = std::nan(""), slope = 0;               // the last root and the slope of the residual there
};

// Torque over a step of length h: the f that solves
//   v = free_velocity + gain f,  f in force(v, moved + h v),
// where free_velocity is the velocity at the end of the step without f, gain = h / inertia, and `force` gives the
// torque at a velocity and a displacement since the state holds, `moved` of it before the step. A static law is
// set-valued where the displacement is zero: there the joint holds, with whatever torque that takes.
template <class Force>
double backward_euler(const Force& force, double moved, double h, double free_velocity, double gain, Search* search) {
  // Friction can jump only where the displacement changes sign: look there first, from either side.
  const double still = -moved / h;
  if (std::isnan(search->forward)) search->forward = force(still, kTiny);
  double g = still - free_velocity - gain * search->forward, f = search->forward;
  if (g > 0) {
    if (std::isnan(search->backward)) search->backward = force(still, -kTiny);
    f = search->backward;
    g = still - free_velocity - gain * f;
    if (g <= 0) return (still - free_velocity) / gain;  // holds
  }
  if (g == 0) return f;

  // The residual g(v) = v - free_velocity - gain f has the sign of `g` at a, the other sign from b on, since
  // friction falls with velocity; where a Stribeck curve makes it rise, b has to move out. In between: secant steps,
  // bisection where they leave the bracket or are slow.
  const bool negative = g < 0;
  double a = still, b = free_velocity + gain * f, last = still, g_last = g;
  bool closed = false;
  const double tolerance = 1e-12 * (std::fabs(free_velocity - still) + std::fabs(b - still));
  const double guess = search->velocity;
  double v = (guess - a) * (guess - b) < 0 ? guess : b;
  for (int i = 0; i < 100; i++) {
    f = force(v, moved + h * v);
    g = v - free_velocity - gain * f;
    if (std::fabs(g) <= tolerance) break;
    if ((g < 0) == negative) {
      a = v;
      if (!closed && v == b) b = still + 2 * (b - still);
    } else {
      b = v;
      closed = true;
    }
    if (std::fabs(b - a) <= tolerance) break;
    const double slope = i == 0 && search->slope > 0 && v == guess ? search->slope : (g - g_last) / (v - last);
    const double next = v - g / slope;
    if (slope > 0) search->slope = slope;
    last = v;
    g_last = g;
    const bool inside = (next - a) * (next - b) < 0;
    v = inside && i % 4 != 3 ? next : closed ? 0.5 * (a + b) : b;
  }
  search->velocity = v;
  return f;
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_BACKWARD_EULER_H_
