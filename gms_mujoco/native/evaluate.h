// The friction of the instances of one mjData within MuJoCo's step.
//
// Explicit joints take their torque with the passive forces, at the position of the step. Late joints, the implicit
// ones, wait for the torque of the actuators and solve all together for the velocities at the end of the step (see
// Joint::slope). What contacts, limits and equalities do to them follows from the friction of this step, and is foretold
// from the steps before. So does the load that friction depends on: it is what the gear transmitted in the step before.
#ifndef GMS_MUJOCO_NATIVE_EVALUATE_H_
#define GMS_MUJOCO_NATIVE_EVALUATE_H_

#include "api.h"
#include "instance.h"

// For mujoco.set_mjcb_control, or after another control callback.
GMS_API void gms_control(const mjModel* m, mjData* d);

namespace gms {

// With the passive forces: explicit joints get their torque, late ones keep their last for now, unless nothing calls us
// later in this step.
void compute_passive(const mjModel* m, mjData* d, Group* g, Instance* instance);

// Torque of all late joints once the forces of the actuators are known; and at the control callback, where none act.
void compute_late(const mjModel* m, mjData* d, Group* g);
void compute_at_control(const mjModel* m, mjData* d, Group* g);

// The motion over the step has happened: the state moves on to where the joints are now.
void advance(const mjModel* m, mjData* d, Instance* instance);

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_EVALUATE_H_
