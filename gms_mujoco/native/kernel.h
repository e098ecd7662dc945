// The friction of one world in a kernel of Warp, for a CPU or a GPU. What Warp compiles is effect.h, hidden_body.h,
// backward_euler.h, tree.h, the laws of the effects' own files and this, one after the other. gms_mujoco/kernel.py puts
// them together and adds what belongs to a model: kJoints, kUses and kImplicit, `modulate` and `torque`, which call the
// law of an effect by its number, and the sizes of local arrays.
#ifndef GMS_MUJOCO_NATIVE_KERNEL_H_
#define GMS_MUJOCO_NATIVE_KERNEL_H_

namespace gms {

// A row of kJoints, and of kUses: one effect on a joint. Where the numbers of an effect stand is counted from the joint's.
// The numbers of the joints that are solved for implicitly stand in kImplicit.
enum { kFirstUse = 0, kNumUses, kFirstParameter, kNumParameters, kFirstState, kNumStates, kIsImplicit, kJointRow };
enum { kEffect = 0, kElements, kUseParameter, kUseState, kUseRow };

// State of a joint: where it is anchored, whether it has not moved since the reset, the torque at the anchor with the
// velocity it was found at, the load; what the joint was given at the last evaluation, by friction and others; how far it
// is ahead of its anchor as that was rounded; then the state of each effect. See Joint in joint.h and kTorque in instance.h.
enum { kAnchor = 0, kAnchorTime, kVirgin, kTorqueThere, kVelocityThere, kLoad, kGiven, kAhead, kOwnState };

inline double total(const int* uses, int n, const double* p, const Motion& motion, const double* state, double* next) {
  Level level;
  for (int i = 0; i < n; i++) {
    const int* x = uses + i * kUseRow;
    modulate(x[kEffect], p + x[kUseParameter], x[kElements], motion, state + x[kUseState], level);
  }
  double sum = 0;
  for (int i = 0; i < n; i++) {
    const int *x = uses + i * kUseRow, at = x[kUseState];
    sum += torque(x[kEffect], p + x[kUseParameter], x[kElements], motion, level, state + at, next + at);
  }
  return sum;
}

// How far a joint is ahead of its position as that was rounded to single precision, after a step in which the position
// changed by `moved`. All integrators but RK4 move a joint by the step times the velocity at its end, the `way`: that is what
// the torque of the step was solved for. Where the two do not belong together somebody has set the joint elsewhere.
inline double ahead_of(double position, double moved, double way) {
  const double digit = 1.2e-7 * std::fmax(std::fabs(position), std::fabs(position - moved));  // 2^-23
  return std::fabs(way - moved) <= digit ? way - moved : 0;
}

// Torque on the joint now, and its state: `before` and `after` may be the same. The first call at a later time moves the
// state on, over a whole number of steps, for time has single precision only; repeated calls at one time change nothing.
// Where time has gone back, or is not a number in the state, the joint has never moved. `pull` is what the
// actuators gave in the step that has led here, less what the rotor took, and `given` what acts on the joint now beside
// friction and actuators: from them comes the load, as in `advance` of evaluate.cc. An implicit joint has its state moved
// on, but no torque yet.
template <class Real>
double evaluate(int number, const Real* parameters, const Real* before, Real* after, double time, double step,
                double position, double velocity, double pull, double given) {
  double p[GMS_MOST_PARAMETERS], state[GMS_MOST_STATES], next[GMS_MOST_STATES];
  const int* joint = kJoints + number * kJointRow;
  const int* uses = kUses + joint[kFirstUse] * kUseRow;
  const int n = joint[kNumUses], n_state = joint[kNumStates];
  for (int i = 0; i < joint[kNumParameters]; i++) p[i] = parameters[joint[kFirstParameter] + i];
  for (int i = 0; i < n_state; i++) state[i] = before[joint[kFirstState] + i];

  const bool reset = !(time >= state[kAnchorTime]), later = time > state[kAnchorTime];
  if (later) state[kLoad] = state[kGiven] + pull;
  Motion motion{position, 0, velocity, 0, time, reset ? 0 : state[kLoad]};
  double f;
  if (reset || (!later && state[kVirgin] != 0)) {  // to be set somewhere after a reset is no motion
    if (reset) {
      for (int i = kLoad; i < n_state; i++) state[i] = 0;
    }
    total(uses, n, p, motion, state, next);  // each effect learns the velocity that it sets out with
    for (int i = kOwnState; i < n_state; i++) state[i] = next[i];
    f = total(uses, n, p, motion, state, next);
  } else if (!later && position == state[kAnchor] && velocity == state[kVelocityThere]) {
    f = state[kTorqueThere];
  } else {
    const double steps = std::fmax(std::floor((time - state[kAnchorTime]) / step + 0.5), 1);
    if (later) motion.duration = step * steps;
    const double moved = position - state[kAnchor], was = state[kAhead];
    if (later) state[kAhead] = steps > 1 ? 0 : ahead_of(position, moved, step * velocity);
    motion.displacement = moved + (later ? state[kAhead] : 0) - was;
    f = total(uses, n, p, motion, state, next);
    for (int i = kOwnState; later && i < n_state; i++) state[i] = next[i];
  }
  if (reset || later || state[kVirgin] != 0) {
    state[kAnchor] = position;
    state[kAnchorTime] = time;
    state[kVirgin] = !later;
    state[kTorqueThere] = f;
    state[kVelocityThere] = velocity;
  }
  if (joint[kIsImplicit]) f = 0;
  state[kGiven] = f + given;
  for (int i = 0; i < n_state; i++) after[joint[kFirstState] + i] = static_cast<Real>(state[i]);
  return f;
}

#ifdef GMS_IMPLICIT

// The law of an implicit joint at the end of a step.
struct Ahead {
  const int *uses, n;
  const double *p, *state;
  Motion now;  // over the time since the anchor
  double h;

  double operator()(double v, double displacement) const {
    const Motion motion{now.position + h * v, displacement, v, now.duration + h, now.time + h, now.load};
    double next[GMS_MOST_STATES];
    return total(uses, n, p, motion, state, next);
  }
};

// What the implicit joints of a world are solved from, and with: rows of `room`, one number for each.
enum { kWhere = 0, kHowFast, kFree, kGivenNow, kPush, kSolved, kResponse };

// Backward Euler for the implicit joints of a world together, by Gauss-Seidel over searches for each, as `sweep` of
// implicit.cc. `room` has where they are; how fast; how fast they would be at the end of the step without their
// friction; what acts on them beside friction and actuators; the torque on each, out; then from row kResponse on the
// change of velocity of each (rows) by a torque on each (columns) over the step. All states are copied.
template <class Real>
void settle(const Real* parameters, const Real* before, Real* after, double time, double step, double* room) {
  constexpr int n = GMS_IMPLICIT;
  Search search[n];
  double moved[n];
  for (int k = 0; k < GMS_STATES; k++) after[k] = before[k];
  for (int k = 0; k < n; k++) {
    search[k].velocity = room[kHowFast * n + k];
    room[kPush * n + k] = before[kJoints[kImplicit[k] * kJointRow + kFirstState] + kTorqueThere];
  }
  for (int pass = 0, changed = 1; pass < 100 && changed; pass++) {
    changed = 0;
    for (int k = 0; k < n; k++) {
      const double *row = room + (kResponse + k) * n, gain = row[k];
      double &push = room[kPush * n + k], &solved = room[kSolved * n + k], v = room[kFree * n + k];
      for (int j = 0; j < n; j++) v += j == k ? 0 : row[j] * room[kPush * n + j];
      if (pass > 0 && std::fabs(v - solved) <= 1e-9 * gain * std::fabs(push)) continue;
      changed = n > 1;
      solved = v;
      double p[GMS_MOST_PARAMETERS], state[GMS_MOST_STATES];
      const int* joint = kJoints + kImplicit[k] * kJointRow;
      for (int i = 0; i < joint[kNumParameters]; i++) p[i] = parameters[joint[kFirstParameter] + i];
      for (int i = 0; i < joint[kNumStates]; i++) state[i] = before[joint[kFirstState] + i];
      const Motion now{room[kWhere * n + k], 0, 0, time - state[kAnchorTime], time, state[kLoad]};
      const Ahead force{kUses + joint[kFirstUse] * kUseRow, joint[kNumUses], p, state, now, step};
      if (pass == 0) {
        moved[k] = now.position - state[kAnchor];
        // What holds at any place stays at the one that was rounded.
        const double ahead = state[kAhead], forward = ahead == 0 ? 0 : force(0, kTiny);
        if (ahead != 0 && force(0, -kTiny) - forward <= 1e-7 * std::fabs(forward)) moved[k] -= ahead;
      }
      push = backward_euler(force, moved[k], step, v, gain, &search[k]);
    }
  }
  for (int k = 0; k < n; k++) {
    const int at = kJoints[kImplicit[k] * kJointRow + kFirstState] + kGiven;
    after[at] = static_cast<Real>(room[kPush * n + k] + room[kGivenNow * n + k]);
  }
}

// Fills kFree and kResponse of `room` for the joints at `dofs`, from what MuJoCo Warp has: the inertia, damping,
// velocity and the torque on each dof without their friction. `work` has a number for each of the inertia and two for each dof.
inline void respond(Tree tree, const float* inertia, const float* damping, float damps, const float* velocity,
                    const float* torque, const int* dofs, double step, double* work, double* room) {
  constexpr int n = GMS_IMPLICIT;
  double *factored = work, *inverse = work + tree.size(), *x = inverse + tree.n;
  for (int i = 0; i < tree.size(); i++) factored[i] = inertia[i];
  for (int i = 0; i < tree.n; i++) {
    factored[tree.diagonal(i)] += step * damps * damping[i];
    x[i] = step * torque[i];
  }
  factor(tree, factored, inverse);
  substitute(tree, factored, inverse, x);
  for (int k = 0; k < n; k++) room[kFree * n + k] = velocity[dofs[k]] + x[dofs[k]];
  for (int j = 0; j < n; j++) {
    for (int i = 0; i < tree.n; i++) x[i] = i == dofs[j] ? step : 0;
    substitute(tree, factored, inverse, x);
    for (int k = 0; k < n; k++) room[(kResponse + k) * n + j] = x[dofs[k]];
  }
}

#endif  // GMS_IMPLICIT

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_KERNEL_H_
