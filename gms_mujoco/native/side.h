// Values side by side, which processors take at once. Left to themselves compilers may take one after the other.
#ifndef GMS_MUJOCO_NATIVE_SIDE_H_
#define GMS_MUJOCO_NATIVE_SIDE_H_

namespace gms {

constexpr int kSide = 4;  // as many as a vector of AVX holds

#ifdef __GNUC__
#define GMS_SIDE  // they can be compared and chosen from, too
using Side = double __attribute__((vector_size(kSide * sizeof(double)), aligned(sizeof(double)), may_alias));
#else
struct Side {
  double x[kSide];
  void operator+=(const Side& o) {
    for (int i = 0; i < kSide; i++) x[i] += o.x[i];
  }
  friend Side operator*(double w, Side o) {
    for (double& x : o.x) x *= w;
    return o;
  }
};
#endif

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_SIDE_H_
