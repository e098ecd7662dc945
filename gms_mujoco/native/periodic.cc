// The torque of a joint in periodic motion, once its state comes back to itself: what a frequency response measures.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "api.h"
#include "joint.h"

namespace {

constexpr int kMostPeriods = 24;
constexpr double kSettled = 1e-7;  // of the largest value that a state takes
constexpr double kWarm = 1e4;      // s since the start: what fades with time has faded

// Where an affine map of two dimensions comes to rest, from four of its iterates (reduced rank extrapolation; Sidi
// 2017): a body behind a coupling swings on for long, and its swing is such a map.
bool extrapolate(const double* const x[4], int n, const double* scale, double* rest) {
  double aa = 0, ab = 0, bb = 0, ac = 0, bc = 0;
  for (int i = 0; i < n; i++) {
    if (!(scale[i] > 0)) continue;
    const double a = (x[1][i] - x[0][i]) / scale[i], b = (x[2][i] - x[1][i]) / scale[i];
    const double c = (x[3][i] - x[2][i]) / scale[i];
    aa += a * a, ab += a * b, bb += b * b, ac += a * c, bc += b * c;
  }
  const double determinant = aa * bb - ab * ab;
  double p = 0, q = 0;
  if (determinant > 1e-12 * aa * bb) {
    p = (ab * bc - bb * ac) / determinant;
    q = (ab * ac - aa * bc) / determinant;
  } else if (bb > 0) {
    q = -bc / bb;
  }
  const double sum = p + q + 1;
  if (!(std::fabs(sum) > 1e-9)) return false;
  for (int i = 0; i < n; i++) rest[i] = (p * x[0][i] + q * x[1][i] + x[2][i]) / sum;
  return true;
}

bool has_load(const gms::Effect* e) {
  for (const gms::Parameter& p : e->parameters) {
    if (p.name && !std::strcmp(p.unit, "kg m^2")) return true;
  }
  return false;
}

}  // namespace

// Torque at the n samples of one period of each of `count` motions, `period[i]` seconds long, in the steady state.
// `position`, `velocity` and `torque` are count x n; with `use` from 0 on `torque` is count x elements x n, that of each
// element of effect number `use` of the joint. Returns how many motions have found no steady state.
GMS_API int gms_joint_cycle(const gms::Joint* joint, int use, int count, int n, const double* period,
                            const double* position, const double* velocity, double* torque) {
  const int size = joint->n_state(), first = gms::Joint::kAnchor;
  std::vector<double> state(size), next(size), scale(size), seen[4];
  const gms::Joint::Use* of = use < 0 ? nullptr : &joint->uses()[use];
  const int width = of ? of->n : 1;
  int failed = 0;
  for (int i = 0; i < count; i++) {
    const double *q = position + static_cast<size_t>(i) * n, *v = velocity + static_cast<size_t>(i) * n;
    double* out = torque + static_cast<size_t>(i) * n * width;
    const double h = period[i] / n;
    joint->reset(state.data());
    joint->torque({kWarm, q[0], v[0]}, state.data(), next.data());
    state.swap(next);
    std::fill(scale.begin(), scale.end(), 0.0);
    seen[0] = state;
    bool settled = false;
    for (int turn = 0, kept = 1; turn < kMostPeriods && !settled; turn++) {
      for (int k = 1; k <= n; k++) {
        const int at = k % n;
        const double t = kWarm + h * (static_cast<double>(turn) * n + k);
        const double total = joint->torque({t, q[at], v[at]}, state.data(), next.data());
        state.swap(next);
        if (!of) {
          out[at] = total;
        } else {
          for (int j = 0; j < width; j++) out[j * n + at] = of->effect->element(state.data() + of->state, j);
        }
        for (int j = first; j < size; j++) scale[j] = std::max(scale[j], std::fabs(state[j]));
      }
      settled = true;
      for (int j = first; j < size && settled; j++) {
        settled = std::fabs(state[j] - seen[kept - 1][j]) <= kSettled * scale[j];
      }
      seen[kept++] = state;
      if (kept < 4 || settled) continue;
      for (const auto& use : joint->uses()) {
        if (!has_load(use.effect)) continue;
        const int s = use.state, length = use.effect->n_state(use.n);
        const double* const x[4] = {&seen[0][s], &seen[1][s], &seen[2][s], &seen[3][s]};
        extrapolate(x, length, &scale[s], &state[s]);
      }
      seen[0] = state;
      kept = 1;
    }
    failed += !settled;
  }
  return failed;
}
