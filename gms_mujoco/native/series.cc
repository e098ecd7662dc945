// Series of samples: the mean torque around each, and what a low-pass leaves of them.
#include <algorithm>
#include <cstddef>

#include "api.h"
#include "series.h"

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

}  // namespace

// Means of `torque`, count x columns, at instants of which the last is a sample: see gms::Means. `mean` is samples x
// columns.
GMS_API void gms_series_mean(int count, const double* instants, int columns, const double* torque, double* mean) {
  gms::Means means(columns);
  const auto take = [&](const double* row) { mean = std::copy_n(row, columns, mean); };
  for (int i = 0; i < count; i++) means.add(instants[i], torque + static_cast<size_t>(i) * columns, take);
  means.end(take);
}

// m weighted sums of `taps` neighbouring rows of `x`, rows x columns, each `stride` rows after the one before; `out` is
// columns x m.
GMS_API void gms_series_band(int taps, const double* kernel, int stride, int m, int columns, const double* x,
                             double* out) {
  if (columns == 1) {
    for (int j = 0; j < m; j++) out[j] = dot(kernel, x + static_cast<size_t>(j) * stride, taps);
    return;
  }
  gms::Band band(taps, kernel, 0, stride, m, columns, out);
  for (int k = 0; k < (m - 1) * stride + taps; k++, x += columns) {
    std::copy_n(x, columns, band.row());
    band.add();
  }
  band.work();
}
