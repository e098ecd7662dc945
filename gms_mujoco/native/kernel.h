// The friction of one joint of one world in a kernel of Warp, for a CPU or a GPU. What Warp compiles is effect.h,
// hidden_body.h, the laws of the effects' own files and this, one after the other. gms_mujoco/kernel.py puts them together
// and adds what belongs to a model: kJoints and kUses, `modulate` and `torque`, which call the law of an effect by its
// number, and the sizes of local arrays.
#ifndef GMS_MUJOCO_NATIVE_KERNEL_H_
#define GMS_MUJOCO_NATIVE_KERNEL_H_

namespace gms {

// A row of kJoints, and of kUses: one effect on a joint. Where the numbers of an effect stand is counted from the joint's.
enum { kFirstUse = 0, kNumUses, kFirstParameter, kNumParameters, kFirstState, kNumStates, kJointRow };
enum { kEffect = 0, kElements, kUseParameter, kUseState, kUseRow };

// State of a joint: where it is anchored, whether it has not moved since the reset, the torque at the anchor with the
// velocity it was found at, the load; what the joint was given at the last evaluation, by friction and others; then the
// state of each effect. See Joint in joint.h and kBookkeeping in instance.h.
enum { kAnchor = 0, kAnchorTime, kVirgin, kTorqueThere, kVelocityThere, kLoad, kGiven, kOwnState };

inline double total(const int* uses, int n, const double* p, const Motion& motion, const double* state, double* next) {
  Level level;
  for (int i = 0; i < n; i++) {
    const int* x = uses + i * kUseRow;
    modulate(x[kEffect], p + x[kUseParameter], x[kElements], motion, level);
  }
  double sum = 0;
  for (int i = 0; i < n; i++) {
    const int *x = uses + i * kUseRow, at = x[kUseState];
    sum += torque(x[kEffect], p + x[kUseParameter], x[kElements], motion, level, state + at, next + at);
  }
  return sum;
}

// Torque on the joint now, and its state: `before` and `after` may be the same. The first call at a later time moves the
// state on, over a whole number of steps, for time has single precision only; repeated calls at one time change nothing.
// Where time has gone back, or is not a number in the state, the joint has never moved. `pull` is what the
// actuators gave in the step that has led here, less what the rotor took, and `given` what acts on the joint now beside
// friction and actuators: from them comes the load, as in `advance` of evaluate.cc.
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
  Motion motion{position, 0, velocity, 0, time, reset ? 0 : state[kLoad], 0};
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
    motion.displacement = position - state[kAnchor];
    const double steps = std::floor((time - state[kAnchorTime]) / step + 0.5);
    if (later) motion.duration = step * std::fmax(steps, 1);
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
  state[kGiven] = f + given;
  for (int i = 0; i < n_state; i++) after[joint[kFirstState] + i] = static_cast<Real>(state[i]);
  return f;
}

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_KERNEL_H_
