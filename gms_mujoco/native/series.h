// Series of samples, row by row: the mean torque around each, and what a low-pass leaves of them. A row has one value for
// each of several columns.
#ifndef GMS_MUJOCO_NATIVE_SERIES_H_
#define GMS_MUJOCO_NATIVE_SERIES_H_

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <vector>

#include "side.h"

namespace gms {

// Sums of `taps` rows of `x`, weighted, over kSides * kSide columns; rows are `width` apart.
template <int kSides>
inline void weigh(const double* weight, int taps, const double* x, int width, double* out) {
  Side sum[kSides] = {};  // that do not wait for each other
  for (int t = 0; t < taps; t++, x += width) {
    for (int i = 0; i < kSides; i++) sum[i] += weight[t] * reinterpret_cast<const Side*>(x)[i];
  }
  std::memcpy(out, sum, sizeof sum);
}

// The same of a whole row, whose `width` is a multiple of kSide.
inline void weigh(const double* weight, int taps, const double* x, int width, double* out) {
  int c = 0;
  for (; c + 4 * kSide <= width; c += 4 * kSide) weigh<4>(weight, taps, x + c, width, out + c);
  if (c + 3 * kSide == width) weigh<3>(weight, taps, x + c, width, out + c);
  if (c + 2 * kSide == width) weigh<2>(weight, taps, x + c, width, out + c);
  if (c + kSide == width) weigh<1>(weight, taps, x + c, width, out + c);
}

// Weighted sums of rows that come one after the other: of `taps` of them from row `first` on, and `m` times in all, each
// `stride` rows after the one before. `out` is columns x m. Each row is multiplied by its
// number in `asked`, where that is not null.
class Band {
 public:
  Band(int taps, const double* kernel, int first, int stride, int m, int columns, double* out,
       const double* asked = nullptr)
      : taps_(taps), kernel_(kernel), stride_(stride), m_(m), columns_(columns),
        width_((columns + kSide - 1) / kSide * kSide), out_(out), asked_(asked), next_(-first),
        rows_(static_cast<size_t>(taps + kRoom) * width_), sums_(width_) {}

  // Where the next row goes; taken in by `add`.
  double* row() { return &*place(std::max(next_, 0)); }

  void add() {
    if (asked_) {
      for (double *x = row(), *end = x + columns_; x < end; x++) *x *= *asked_;
      asked_++;
    }
    if (done_ < m_ && ++next_ == taps_ + kRoom) work();
  }

  // Makes the sums that the rows at hand allow.
  void work() {
    int at = 0;
    for (; at + taps_ <= next_ && done_ < m_; at += stride_, done_++) {
      weigh(kernel_, taps_, &*place(at), width_, sums_.data());
      for (int c = 0; c < columns_; c++) out_[static_cast<size_t>(c) * m_ + done_] = sums_[c];
    }
    if (at < next_) std::copy(place(at), place(next_), place(0));
    next_ -= at;
  }

 private:
  static constexpr int kRoom = 128;  // rows between two turns of work

  std::vector<double>::iterator place(int row) { return rows_.begin() + static_cast<size_t>(row) * width_; }

  const int taps_;
  const double* kernel_;
  const int stride_, m_, columns_, width_;
  double* out_;
  const double* asked_;
  int next_, done_ = 0;  // rows at hand (less than 0: rows to come before the first), sums made
  std::vector<double> rows_, sums_;
};

// Mean torque around each sample, with weights that fall linearly to zero at the samples beside it; at the first and the
// last the torque itself. It runs straight between instants, every sample among them. `take(row)` gets them in turn.
class Means {
 public:
  explicit Means(int columns) : columns_(columns), last_(columns), here_(columns), next_(columns) {}

  // The torque at the next instant, in samples from the first.
  template <class Take>
  void add(double instant, const double* torque, Take take) {
    const int k = static_cast<int>(at_);
    if (instant > 0) {
      const double u = at_ - k, v = instant - k, w = v - u;
      const double from = w * (2 * u + v) / 6, to = w * (u + 2 * v) / 6;  // rising weights of both ends
      for (int c = 0; c < columns_; c++) {
        const double up = from * last_[c] + to * torque[c];
        next_[c] += up;
        here_[c] += 0.5 * w * (last_[c] + torque[c]) - up;
      }
      if (instant == k + 1) {
        if (k > 0) take(here_.data());
        here_.swap(next_);
        std::fill(next_.begin(), next_.end(), 0.0);
      }
    } else {
      take(torque);
    }
    std::copy_n(torque, columns_, last_.begin());
    at_ = instant;
  }

  template <class Take>
  void end(Take take) {
    if (at_ > 0) take(last_.data());
  }

 private:
  const int columns_;
  std::vector<double> last_, here_, next_;
  double at_ = 0;
};

}  // namespace gms

#endif  // GMS_MUJOCO_NATIVE_SERIES_H_
