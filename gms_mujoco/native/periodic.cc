// The torque of a joint in periodic motion, once its state comes back to itself: what a frequency response measures.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "api.h"
#include "joint.h"

namespace {

constexpr int kMostPeriods = 24;
constexpr int kLook = 4;  // samples after which a state is compared with that of a turn ago
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

bool turns_round(const gms::Joint& joint) {
  for (const auto& use : joint.uses()) {
    if (!use.effect->turns_round) return false;
  }
  return true;
}

// Whether the second half of a period (n,) is the first one the other way round.
bool is_half_wave(const double* x, int n) {
  if (n % 2) return false;
  double most = 0, off = 0;
  for (int k = 0; k < n / 2; k++) {
    most = std::max(most, std::fabs(x[k]));
    off = std::max(off, std::fabs(x[k] + x[k + n / 2]));
  }
  return off <= 1e-9 * most;
}

// One motion until its torque repeats itself.
struct Cycle {
  const gms::Joint& joint;
  const gms::Joint::Use* of;  // whose elements are asked for; null: the torque of all
  int n;
  std::vector<double> state, next, scale, seen[4], before, apart;

  Cycle(const gms::Joint& joint, const gms::Joint::Use* of, int n)
      : joint(joint), of(of), n(n), state(joint.n_state()), next(state), scale(state) {
    for (auto& x : seen) x = state;
    before.resize(state.size() * n);
    apart.resize(of ? of->n : 0);
  }

  bool is_close(const double* x) const {
    for (size_t j = gms::Joint::kAnchor; j < state.size(); j++) {
      if (std::fabs(state[j] - x[j]) > kSettled * scale[j]) return false;
    }
    return true;
  }

  // Fills in `out`, elements x n. With `half` the second half follows from the first, and so does the state.
  bool settle(double h, const double* q, const double* v, bool half, double* out) {
    const int size = static_cast<int>(state.size()), first = gms::Joint::kAnchor, width = of ? of->n : 1;
    int last = half ? n / 2 : n;
    joint.reset(state.data());
    std::fill(scale.begin(), scale.end(), 0.0);
    // Friction that begins at rest in the middle stands at the crest as it will ever after (Masing's rule).
    const int rise = half ? n - n / 4 : n;
    for (int k = rise; k <= n; k++) {
      joint.torque({kWarm + h * (k - n), half && k == rise ? 0 : q[k % n], v[k % n]}, state.data(), next.data());
      state.swap(next);
    }
    seen[0] = state;
    bool settled = false, leapt = true;
    int kept = 1;
    double start = kWarm;
    for (int turn = 0; turn < kMostPeriods && !settled; turn++, start += h * last) {
      for (int k = 1; k <= last && !settled; k++) {
        const int at = k % n;
        const double t = start + h * k;
        const double total = joint.torque({t, q[at], v[at]}, state.data(), next.data());
        state.swap(next);
        if (!of) {
          out[at] = total;
        } else {
          of->effect->elements(state.data() + of->state, width, apart.data());
          for (int j = 0; j < width; j++) out[j * n + at] = apart[j];
        }
        for (int j = first; j < size; j++) scale[j] = std::max(scale[j], std::fabs(state[j]));
        // From where it stands as it did a turn ago, all will be as it was.
        double* const then = &before[static_cast<size_t>(k - 1) * size];
        settled = !leapt && k % kLook == 0 && is_close(then);
        std::copy(state.begin(), state.end(), then);
      }
      if (settled) break;
      if (half) {  // what it is at the trough it is at the crest, with the other sign
        for (int j = 0; j < size; j++) state[j] = j == 1 ? state[j] : -state[j];
      }
      settled = is_close(seen[kept - 1].data());
      leapt = false;
      const bool again = turn + 1 < kMostPeriods;
      if (half && again && !settled && kept > 1 && is_close(seen[kept - 2].data())) {  // alike after a whole period
        half = false;
        last = n;
        leapt = true;
      }
      seen[kept++] = state;
      if (kept < 4 || settled) continue;
      for (const auto& use : joint.uses()) {
        if (!has_load(use.effect)) continue;
        const int s = use.state, length = use.effect->n_state(use.n);
        const double* const x[4] = {&seen[0][s], &seen[1][s], &seen[2][s], &seen[3][s]};
        leapt |= extrapolate(x, length, &scale[s], &state[s]);
      }
      seen[0] = state;
      kept = 1;
    }
    if (half) {
      for (int j = 0; j < width; j++) {
        double* const row = out + static_cast<size_t>(j) * n;
        row[0] = -row[n / 2];
        for (int k = 1; k < n / 2; k++) row[k + n / 2] = -row[k];
      }
    }
    return settled;
  }
};

}  // namespace

// Torque at the n samples of one period of each of `count` motions, `period[i]` seconds long, in the steady state.
// `position`, `velocity` and `torque` are count x n; with `use` from 0 on `torque` is count x elements x n, that of each
// element of effect number `use` of the joint. Returns how many motions have found no steady state.
GMS_API int gms_joint_cycle(const gms::Joint* joint, int use, int count, int n, const double* period,
                            const double* position, const double* velocity, double* torque) {
  const gms::Joint::Use* of = use < 0 ? nullptr : &joint->uses()[use];
  const bool mirrored = turns_round(*joint);
  Cycle cycle(*joint, of, n);
  int failed = 0;
  for (int i = 0; i < count; i++) {
    const size_t at = static_cast<size_t>(i) * n;
    const double *q = position + at, *v = velocity + at;
    const bool half = mirrored && is_half_wave(q, n) && is_half_wave(v, n);
    failed += !cycle.settle(period[i] / n, q, v, half, torque + at * (of ? of->n : 1));
  }
  return failed;
}
