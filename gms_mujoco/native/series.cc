// Series of samples: the mean torque around each, and what a low-pass leaves of them.
#include <algorithm>
#include <cstddef>

#include "api.h"

namespace {

// The dot product of `taps` weights and values, in sums that do not wait for each other.
double dot(const double* weight, const double* x, int taps) {
  constexpr int kLanes = 8;
  double sum[kLanes] = {};
  int t = 0;
  for (; t + kLanes <= taps; t += kLanes) {
    for (int i = 0; i < kLanes; i++) sum[i] += weight[t + i] * x[t + i];
  }
  double rest = 0;
  for (; t < taps; t++) rest += weight[t] * x[t];
  for (int i = 0; i < kLanes; i++) rest += sum[i];
  return rest;
}

// The same of four columns that lie side by side, `columns` apart from one row to the next.
void dot_four(const double* weight, const double* x, int taps, int columns, double* out, int m) {
  double sum[4] = {};
  for (int t = 0; t < taps; t++, x += columns) {
    for (int i = 0; i < 4; i++) sum[i] += weight[t] * x[i];
  }
  for (int i = 0; i < 4; i++) out[static_cast<size_t>(i) * m] = sum[i];
}

}  // namespace

// Mean torque around each sample, with weights that fall linearly to zero at the samples beside it; at the first and the
// last the torque itself. `torque`, count x columns, runs straight between `instants`, which rise, in samples from the
// first, every sample among them; `mean` is samples x columns.
GMS_API void gms_series_mean(int count, const double* instants, int columns, const double* torque, double* mean) {
  const int last = static_cast<int>(instants[count - 1]);
  std::fill(mean, mean + static_cast<size_t>(last + 1) * columns, 0.0);
  for (int i = 0; i + 1 < count; i++) {
    const int k = static_cast<int>(instants[i]);
    const double u = instants[i] - k, v = instants[i + 1] - k, w = v - u;
    const double from = w * (2 * u + v) / 6, to = w * (u + 2 * v) / 6;  // rising weights of both ends
    const double* f = torque + static_cast<size_t>(i) * columns;
    const double* g = f + columns;
    double* here = mean + static_cast<size_t>(k) * columns;
    double* next = here + columns;
    for (int c = 0; c < columns; c++) {
      const double up = from * f[c] + to * g[c];
      next[c] += up;
      here[c] += 0.5 * w * (f[c] + g[c]) - up;
    }
  }
  std::copy(torque, torque + columns, mean);
  std::copy_n(torque + static_cast<size_t>(count - 1) * columns, columns, mean + static_cast<size_t>(last) * columns);
}

// m weighted sums of `taps` neighbouring rows of `x`, rows x columns, each `stride` rows after the one before; `out` is
// columns x m.
GMS_API void gms_series_band(int taps, const double* kernel, int stride, int m, int columns, const double* x,
                             double* out) {
  for (int j = 0; j < m; j++) {
    const double* row = x + static_cast<size_t>(j) * stride * columns;
    int c = 0;
    for (; c + 4 <= columns; c += 4) dot_four(kernel, row + c, taps, columns, out + static_cast<size_t>(c) * m + j, m);
    for (; c < columns; c++) {
      double sum = 0;
      if (columns == 1) {
        sum = dot(kernel, row, taps);
      } else {
        for (int t = 0; t < taps; t++) sum += kernel[t] * row[static_cast<size_t>(t) * columns + c];
      }
      out[static_cast<size_t>(c) * m + j] = sum;
    }
  }
}
