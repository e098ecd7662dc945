// A servo that closes its own position loop, and the pendulum on its shaft: what Python calls to simulate one run.
#include <algorithm>

#include "api.h"
#include "single_axis.h"

namespace {

// The parameters of gms_mujoco/effects/position_loop.py in the order of its table, then that of least_duty.py.
struct Loop {
  double gain, duty_per_rad, stall_torque, electrical_drag, goal_speed, duty_limit, least_duty;
};

constexpr double kLittle = 1e-3;  // rad, within which the least duty changes its sign: half a count of a hobby servo

// The goal as it reaches the loop: late, and no faster than the goal speed. Both act between the steps too, so that the
// motion changes smoothly with them.
class InnerGoal {
 public:
  InnerGoal(int n, const double* time, const double* goal, double speed)
      : n_(n), time_(time), goal_(goal), speed_(speed), value_(goal[0]), now_(time[0]) {}

  // Goes on to an instant that is not before the last one.
  double at(double instant) {
    for (; next() <= instant; sample_++) follow(next());
    follow(instant);
    return value_;
  }

  // The sample that holds now.
  int sample() const { return sample_; }

 private:
  double next() const { return sample_ + 1 < n_ ? time_[sample_ + 1] : gms::kInfinity; }

  void follow(double instant) {
    const double most = speed_ * std::max(instant - now_, 0.0), left = goal_[sample_] - value_;
    value_ += std::min(std::max(left, -most), most);
    now_ = std::max(instant, now_);
  }

  const int n_;
  const double *time_, *goal_, speed_;
  double value_, now_;
  int sample_ = 0;
};

}  // namespace

// Motion of a servo from its goal: position[k] and velocity[k] at k = 0 .. steps - 1 times h after time[0], the first of
// each being where it begins. goal[i] and powered[i] (above 0.5: the bridge is on) hold from time[i], of n samples, and
// act `delay` later. The joint carries a payload with a torque of -weight sin(q). `inertia` is that of all that moves,
// `rotor` the part of it before the gear.
// Returns the number of steps done, fewer where the motion ran away.
GMS_API int gms_servo_simulate(const gms::Joint* joint, int steps, double h, double inertia, double rotor,
                               double weight, const double* loop, double delay, int n, const double* time,
                               const double* goal, const double* powered, double* position, double* velocity) {
  Loop p;
  std::memcpy(&p, loop, sizeof p);
  gms::Sample now{0, position[0], velocity[0]};
  gms::SingleAxis axis(*joint, inertia, h, -1, now);
  InnerGoal inner(n, time, goal, p.goal_speed);
  for (int k = 0; k < steps; k++) {
    position[k] = now.position;
    velocity[k] = now.velocity;
    if (!std::isfinite(now.position)) return k;
    const double begin = time[0] + k * h - delay;
    inner.at(begin);
    const bool on = powered[inner.sample()] > 0.5;
    const double error = inner.at(begin + h) - now.position;  // MuJoCo's dcmotor takes the goal at the end of a step
    double motor = 0;
    if (on) {
      const double push = std::min(std::max(error / kLittle, -1.0), 1.0);
      const double duty = p.gain * p.duty_per_rad * error + p.least_duty * push;
      motor = p.stall_torque * std::min(std::max(duty, -p.duty_limit), p.duty_limit) - p.electrical_drag * now.velocity;
    }
    const double applied = motor - weight * std::sin(now.position);
    const double friction = axis.torque(now, applied), before = now.velocity;
    axis.step(&now, applied + friction);
    now.load = motor + friction - rotor * (now.velocity - before) / h;  // what the gear transmits, as in the plug-in
  }
  return steps;
}
