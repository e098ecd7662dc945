// One axis with its friction, step by step: semi-implicit Euler as MuJoCo's.
#ifndef GMS_MUJOCO_NATIVE_SINGLE_AXIS_H_
#define GMS_MUJOCO_NATIVE_SINGLE_AXIS_H_

#include <algorithm>
#include <vector>

#include "implicit.h"
#include "joint.h"

namespace gms {

class SingleAxis {
 public:
  // Steps of length h. `implicit`: the effects are taken by backward Euler (1), at the beginning of a step (0), or by
  // backward Euler where the step is long for their stiffness (-1). The state before the first sample is `initial`
  // (n_state), or comes from `memory` (n_memory); both may be null: never moved.
  SingleAxis(const Joint& joint, double inertia, double h, int implicit, const Sample& first,
             const double* memory = nullptr, const double* initial = nullptr)
      : joint_(joint), h_(h), inertia_(inertia), mobility_(1 / inertia), steepest_(joint.slope(h)),
        state_(joint.n_state()), next_(joint.n_state()) {
    if (initial) {
      std::copy(initial, initial + joint.n_state(), state_.begin());
    } else {
      joint.begin(memory, first, state_.data());
    }
    implicit_ = implicit < 0 ? h * steepest_ * mobility_ > kExplicitLimit : implicit != 0;
    solver_.reserve(1, 1, 1);
  }

  // Torque of the effects over the step from `now`, beside the torque `applied`.
  double torque(const Sample& now, double applied) {
    double f = joint_.torque(now, state_.data(), next_.data());
    state_.swap(next_);
    if (implicit_) {
      const int one = 1, zero = 0;
      const Inertia inertia{{1, &one, &zero, &zero}, &inertia_, nullptr, nullptr};
      Implicit::Unit unit;
      unit.joint = &joint_;
      unit.dof = 0;
      unit.weight = mobility_;
      unit.steepest = steepest_;
      unit.now = now;
      unit.state = state_.data();
      unit.torque = f;
      unit.slope = slope_;
      solver_.units = &unit;
      solver_.solve(1, inertia, nullptr, &now.velocity, &applied, h_);
      f = unit.torque;
      slope_ = unit.slope;
    }
    return f;
  }

  // Moves on by one step under the sum of all torques.
  void step(Sample* now, double total) const {
    now->velocity += h_ * (total * mobility_);
    now->position += h_ * now->velocity;
    now->time += h_;
  }

  // At the beginning of the step whose torque was asked for last.
  const std::vector<double>& state() const { return state_; }

 private:
  const Joint& joint_;
  const double h_, inertia_, mobility_, steepest_;
  std::vector<double> state_, next_;
  Implicit solver_;
  bool implicit_;
  double slope_ = -1;
};

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_SINGLE_AXIS_H_
