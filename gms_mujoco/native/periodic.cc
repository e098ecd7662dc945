// The torque of a joint in periodic motion, once its state comes back to itself: what a frequency response measures.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <numeric>
#include <vector>

#include "api.h"
#include "joint.h"
#include "side_by_side.h"

namespace {

constexpr int kMostPeriods = 24;
constexpr int kLook = 4;  // samples after which a state is compared with that of a turn ago
constexpr int kWorthAThread = 32;  // motions: fewer are done before another thread has woken
constexpr int kBeside = 8;         // motions at a time on a thread: what they need is in the cache
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

// One motion until its torque repeats itself. Step by step, so that several can go side by side.
class Cycle {
 public:
  // `of`: whose elements are asked for; null: the torque of all.
  Cycle(const gms::Joint& joint, const gms::Joint::Use* of, int n)
      : joint_(&joint), of_(of), n_(n), state_(joint.n_state()), next_(state_), scale_(state_) {
    for (auto& x : seen_) x = state_;
    before_.resize(state_.size() * (n / kLook + 1));
    apart_.resize(of ? of->n : 0);
  }

  // Fills in `out`, elements x n. With `half` the second half follows from the first, and so does the state.
  void begin(double h, const double* q, const double* v, bool half, double* out) {
    h_ = h, q_ = q, v_ = v, half_ = half, out_ = out;
    joint_->reset(state_.data());
    std::fill(scale_.begin(), scale_.end(), 0.0);
    // Friction that begins at rest in the middle stands at the crest as it will ever after (Masing's rule).
    rest_ = half ? -(n_ / 4) : -1;
    k_ = half ? rest_ : 0;
    last_ = half ? n_ / 2 : n_;
    start_ = kWarm;
    turn_ = 0;
    settled_ = false, leapt_ = true;
  }

  gms::Motion next() const {
    const int at = (k_ + n_) % n_;
    return gms::Joint::since({start_ + h_ * k_, k_ == rest_ ? 0 : q_[at], v_[at]}, state_.data());
  }
  double* state() { return state_.data(); }
  double* room() { return next_.data(); }

  // Takes in the torque over that motion, and the state that is in `room` now; whether it is the end.
  bool take(double torque) {
    const gms::Level level = of_ ? joint_->level(next(), state_.data()) : gms::Level();
    state_.swap(next_);
    if (k_++ <= 0) {
      if (k_ > 0) seen_[0] = state_, kept_ = 1;
      return false;
    }
    note(k_ - 1, torque, level);
    if (!settled_ && k_ <= last_) return false;
    if (!settled_) turned();
    if (!settled_ && turn_ < kMostPeriods) return false;
    if (half_) complete();
    return true;
  }
  bool settled() const { return settled_; }

 private:
  bool is_close(const double* x) const {
    for (size_t j = gms::Joint::kAnchor; j < state_.size(); j++) {
      if (std::fabs(state_[j] - x[j]) > kSettled * scale_[j]) return false;
    }
    return true;
  }

  // Sample k of a turn, from 1 on; the level scales the torques of elements.
  void note(int k, double torque, const gms::Level& level) {
    const int at = k % n_;
    if (!of_) {
      out_[at] = torque;
    } else {
      of_->effect->elements(state_.data() + of_->state, of_->n, apart_.data());
      const double scale = level.of(std::accumulate(apart_.begin(), apart_.end(), 0.0));
      for (int j = 0; j < of_->n; j++) out_[j * n_ + at] = scale * apart_[j];
    }
    for (size_t j = gms::Joint::kAnchor; j < state_.size(); j++) scale_[j] = std::max(scale_[j], std::fabs(state_[j]));
    if (k % kLook) return;
    // From where it stands as it did a turn ago, all will be as it was.
    double* const then = &before_[(k / kLook) * state_.size()];
    settled_ = !leapt_ && is_close(then);
    std::copy(state_.begin(), state_.end(), then);
  }

  // At the end of a turn.
  void turned() {
    start_ += h_ * last_;
    k_ = 1;
    turn_++;
    if (half_) {  // what it is at the trough it is at the crest, with the other sign
      for (size_t j = 0; j < state_.size(); j++) state_[j] = j == 1 ? state_[j] : -state_[j];
    }
    settled_ = is_close(seen_[kept_ - 1].data());
    leapt_ = false;
    const bool again = turn_ < kMostPeriods;
    if (half_ && again && !settled_ && kept_ > 1 && is_close(seen_[kept_ - 2].data())) {  // alike after a whole period
      half_ = false;
      last_ = n_;
      leapt_ = true;
    }
    seen_[kept_++] = state_;
    if (kept_ < 4 || settled_) return;
    for (const auto& use : joint_->uses()) {
      if (!has_load(use.effect)) continue;
      const int s = use.state, length = use.effect->n_state(use.n);
      const double* const x[4] = {&seen_[0][s], &seen_[1][s], &seen_[2][s], &seen_[3][s]};
      leapt_ |= extrapolate(x, length, &scale_[s], &state_[s]);
    }
    seen_[0] = state_;
    kept_ = 1;
  }

  void complete() {
    for (int j = 0; j < (of_ ? of_->n : 1); j++) {
      double* const row = out_ + static_cast<size_t>(j) * n_;
      row[0] = -row[n_ / 2];
      for (int k = 1; k < n_ / 2; k++) row[k + n_ / 2] = -row[k];
    }
  }

  const gms::Joint* joint_;
  const gms::Joint::Use* of_;
  int n_, last_ = 0, rest_ = 0;  // samples of a period, of a turn; the one that begins in the middle of the motion
  int k_ = 0, turn_ = 0, kept_ = 0;
  double h_ = 0, start_ = 0;
  const double *q_ = nullptr, *v_ = nullptr;
  double* out_ = nullptr;
  bool half_ = false, settled_ = false, leapt_ = false;
  std::vector<double> state_, next_, scale_, seen_[4], before_, apart_;
};

}  // namespace

// Torque at the n samples of one period of each of `count` motions, `period[i]` seconds long, in the steady state.
// `position`, `velocity` and `torque` are count x n; with `use` from 0 on `torque` is count x elements x n, that of each
// element of effect number `use` of the joint. Returns how many motions have found no steady state.
GMS_API int gms_joint_cycle(const gms::Joint* joint, int use, int threads, int count, int n, const double* period,
                            const double* position, const double* velocity, double* torque) {
  const gms::Joint::Use* of = use < 0 ? nullptr : &joint->uses()[use];
  const bool mirrored = turns_round(*joint);
  std::atomic<int> begun{0}, failed{0};
  // The next motion that nobody has begun.
  const auto begin = [&](Cycle& cycle) {
    const int i = begun++;
    if (i >= count) return false;
    const size_t at = static_cast<size_t>(i) * n;
    const double *q = position + at, *v = velocity + at;
    const bool half = mirrored && is_half_wave(q, n) && is_half_wave(v, n);
    cycle.begin(period[i] / n, q, v, half, torque + at * (of ? of->n : 1));
    return true;
  };
  gms::side_by_side(std::min(threads, count / kWorthAThread), [&] {
    std::vector<Cycle> cycles(std::min({count, joint->at_once(), kBeside}), Cycle(*joint, of, n));
    gms::Together t;
    int busy = 0;
    while (busy < static_cast<int>(cycles.size()) && begin(cycles[busy])) t.joint[busy++] = joint;
    while (busy > 0) {
      for (int j = 0; j < busy; j++) {
        t.motion[j] = cycles[j].next();
        t.state[j] = cycles[j].state();
        t.room[j] = cycles[j].room();
      }
      gms::Joint::torques(busy, t.joint, t.motion, t.state, t.room, t.torque);
      for (int j = busy - 1; j >= 0; j--) {
        if (!cycles[j].take(t.torque[j])) continue;
        failed += !cycles[j].settled();
        if (!begin(cycles[j])) std::swap(cycles[j], cycles[--busy]);
      }
    }
  });
  return failed;
}
