#include "sonocal/detection/gaussian_blur.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace sonocal {
namespace {

constexpr double kWide = 2.0;  // standard deviation from which three boxes are both close and faster
constexpr int kBoxes = 3;

// One half of a Gaussian's taps, from the centre; the sum over both halves is 1.
std::vector<float> half_gaussian(double sigma) {
  const int radius = std::max(1, static_cast<int>(std::ceil(3 * sigma)));
  std::vector<double> taps(radius + 1);
  double sum = 0;
  for (int i = 0; i <= radius; ++i) {
    taps[i] = std::exp(-0.5 * i * i / (sigma * sigma));
    sum += i ? 2 * taps[i] : taps[i];
  }
  std::vector<float> out;
  for (const double tap : taps) out.push_back(static_cast<float>(tap / sum));
  return out;
}

void narrow(std::vector<float>& values, std::vector<float>& scratch, int rows, int n, double sigma) {
  const std::vector<float> half = half_gaussian(sigma);
  const int radius = static_cast<int>(half.size()) - 1;
  std::vector<float> padded(n + 2 * radius, 0.0f);
  for (int r = 0; r < rows; ++r) {
    float* out = scratch.data() + static_cast<std::size_t>(r) * n;
    std::copy_n(values.data() + static_cast<std::size_t>(r) * n, n, padded.begin() + radius);
    const float* centre = padded.data() + radius;
    for (int c = 0; c < n; ++c) out[c] = half[0] * centre[c];
    for (int k = 1; k <= radius; ++k)
      for (int c = 0; c < n; ++c) out[c] += half[k] * (centre[c - k] + centre[c + k]);
  }
  for (int r = 0; r < rows; ++r) {
    float* out = values.data() + static_cast<std::size_t>(r) * n;
    std::fill_n(out, n, 0.0f);
    for (int k = -radius; k <= radius; ++k) {
      if (r + k < 0 || r + k >= rows) continue;
      const float* in = scratch.data() + static_cast<std::size_t>(r + k) * n;
      const float tap = half[std::abs(k)];
      for (int c = 0; c < n; ++c) out[c] += tap * in[c];
    }
  }
}

// Running sums over windows of 2 radius + 1, along rows and then down columns.
void box(std::vector<float>& values, std::vector<float>& scratch, int rows, int n, int radius) {
  const float share = 1.0f / (2 * radius + 1);
  for (int r = 0; r < rows; ++r) {
    const float* in = values.data() + static_cast<std::size_t>(r) * n;
    float* out = scratch.data() + static_cast<std::size_t>(r) * n;
    float sum = 0;
    for (int c = 0; c < std::min(radius, n); ++c) sum += in[c];
    for (int c = 0; c < n; ++c) {
      if (c + radius < n) sum += in[c + radius];
      out[c] = share * sum;
      if (c >= radius) sum -= in[c - radius];
    }
  }
  std::vector<float> sums(n, 0.0f);
  const auto add = [&](int r, float sign) {
    const float* in = scratch.data() + static_cast<std::size_t>(r) * n;
    for (int c = 0; c < n; ++c) sums[c] += sign * in[c];
  };
  for (int r = 0; r < std::min(radius, rows); ++r) add(r, 1);
  for (int r = 0; r < rows; ++r) {
    if (r + radius < rows) add(r + radius, 1);
    float* out = values.data() + static_cast<std::size_t>(r) * n;
    for (int c = 0; c < n; ++c) out[c] = share * sums[c];
    if (r >= radius) add(r - radius, -1);
  }
}

}  // namespace

void gaussian_blur(std::vector<float>& values, std::vector<float>& scratch, int rows, int cols,
                   double sigma) {
  if (sigma < kWide) {
    narrow(values, scratch, rows, cols, sigma);
    return;
  }
  // A box of radius r has the variance r (r + 1) / 3; so many of the boxes are one wider that the sum fits.
  const double each = sigma * sigma / kBoxes;
  const int radius = static_cast<int>((std::sqrt(1 + 12 * each) - 1) / 2);
  const double missing = sigma * sigma - kBoxes * radius * (radius + 1) / 3.0;
  const int wider = static_cast<int>(std::lround(missing / ((2 * radius + 2) / 3.0)));
  for (int i = 0; i < kBoxes; ++i) box(values, scratch, rows, cols, radius + (i < wider));
}

}  // namespace sonocal
