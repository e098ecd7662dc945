// Work on several threads at a time.
#ifndef GMS_MUJOCO_NATIVE_SIDE_BY_SIDE_H_
#define GMS_MUJOCO_NATIVE_SIDE_BY_SIDE_H_

#include <functional>

namespace gms {

// Calls `work` on this thread and on up to threads - 1 others, all at a time, and returns when every call has: each takes
// from what there is to do until nothing is left. The others sleep in between, so that work of a tenth of a millisecond is
// worth it; while another thread has them this one works alone.
void side_by_side(int threads, const std::function<void()>& work);

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_SIDE_BY_SIDE_H_
