#include "sonocal/detection/blob_filter.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace sonocal {
namespace {

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

// The median of |values| where the weight is whole, from every few of them.
float median_magnitude(const std::vector<float>& values, const std::vector<float>& weight) {
  std::vector<float> sample;
  const std::size_t step = std::max<std::size_t>(1, values.size() / 16384);
  for (std::size_t i = 0; i < values.size(); i += step)
    if (weight[i] > 0.5f) sample.push_back(std::abs(values[i]));
  if (sample.empty()) return 0;
  std::nth_element(sample.begin(), sample.begin() + sample.size() / 2, sample.end());
  return sample[sample.size() / 2];
}

}  // namespace

BlobFilter::BlobFilter(const unsigned char* mask, int rows, int cols, std::vector<double> scales, int pool)
    : rows_(rows),
      cols_(cols),
      pool_(pool),
      small_rows_((rows + pool - 1) / pool),
      small_cols_((cols + pool - 1) / pool),
      scales_(std::move(scales)),
      mask_(mask, mask + static_cast<std::size_t>(rows) * cols),
      seen_(mask_.size(), 0) {
  const std::size_t size = static_cast<std::size_t>(small_rows_) * small_cols_;
  best_.resize(size);
  best_level_.resize(size);
  scratch_.resize(size);
  pooled_.resize(size);
  std::vector<float> ones(mask_.size(), 1.0f);
  pool_image(ones.data());
  weight_ = pooled_;
  double before = 0;
  std::vector<float> values = weight_;
  for (const double scale : scales_) {
    const double sigma = scale / pool_;
    kernels_.push_back(half_gaussian(std::sqrt(sigma * sigma - before * before)));
    before = sigma;
    blur(values, kernels_.back());
    normalisers_.push_back(values);
    for (float& x : normalisers_.back()) x = x > 1e-3f ? 1 / x : 0;
  }
  levels_.resize(scales_.size(), std::vector<float>(size));
}

// Sums the unmasked pixels of every square, divided by the square's area.
void BlobFilter::pool_image(const float* image) {
  std::fill(pooled_.begin(), pooled_.end(), 0.0f);
  const float share = 1.0f / (static_cast<float>(pool_) * pool_);
  for (int r = 0; r < rows_; ++r) {
    float* out = pooled_.data() + static_cast<std::size_t>(r / pool_) * small_cols_;
    const std::size_t at = static_cast<std::size_t>(r) * cols_;
    for (int c = 0, k = 0; c < cols_; ++k) {
      const int end = std::min(c + pool_, cols_);
      float sum = 0;
      for (; c < end; ++c) sum += mask_[at + c] ? image[at + c] : 0.0f;
      out[k] += share * sum;
    }
  }
}

// Separable; outside the image there is nothing, which the normaliser undoes.
void BlobFilter::blur(std::vector<float>& values, const std::vector<float>& half) {
  const int radius = static_cast<int>(half.size()) - 1, n = small_cols_;
  std::vector<float> padded(n + 2 * radius, 0.0f);
  for (int r = 0; r < small_rows_; ++r) {
    const float* in = values.data() + static_cast<std::size_t>(r) * n;
    float* out = scratch_.data() + static_cast<std::size_t>(r) * n;
    std::copy_n(in, n, padded.begin() + radius);
    const float* centre = padded.data() + radius;
    for (int c = 0; c < n; ++c) out[c] = half[0] * centre[c];
    for (int k = 1; k <= radius; ++k)
      for (int c = 0; c < n; ++c) out[c] += half[k] * (centre[c - k] + centre[c + k]);
  }
  for (int r = 0; r < small_rows_; ++r) {
    float* out = values.data() + static_cast<std::size_t>(r) * n;
    std::fill_n(out, n, 0.0f);
    for (int k = -radius; k <= radius; ++k) {
      if (r + k < 0 || r + k >= small_rows_) continue;
      const float* in = scratch_.data() + static_cast<std::size_t>(r + k) * n;
      const float tap = half[std::abs(k)];
      for (int c = 0; c < n; ++c) out[c] += tap * in[c];
    }
  }
}

void BlobFilter::respond(double least_contrast) {
  const std::size_t size = best_.size();
  std::vector<float>& running = pooled_;
  for (std::size_t i = 0; i < scales_.size(); ++i) {
    blur(running, kernels_[i]);
    const float* normaliser = normalisers_[i].data();
    for (std::size_t k = 0; k < size; ++k) levels_[i][k] = running[k] * normaliser[k];
  }
  std::fill(best_.begin(), best_.end(), 0.0f);
  for (std::size_t i = 0; i + 1 < scales_.size(); ++i) {
    for (std::size_t k = 0; k < size; ++k) scratch_[k] = levels_[i][k] - levels_[i + 1][k];
    // 1.48 median |x| is a normal deviate's standard deviation, deaf to the few bright places.
    const float noise =
        std::max(1.4826f * median_magnitude(scratch_, weight_), static_cast<float>(least_contrast));
    for (std::size_t k = 0; k < size; ++k) {
      const float score = weight_[k] > 0.5f ? scratch_[k] / noise : 0.0f;
      best_level_[k] = score > best_[k] ? static_cast<int>(i) : best_level_[k];
      best_[k] = std::max(best_[k], score);
    }
  }
}

// Local maxima, best first, none within the width of a better one.
std::vector<BlobFilter::Peak> BlobFilter::peaks(double least_score, int most) const {
  std::vector<Peak> found;
  const int n = small_cols_;
  for (int r = 0; r < small_rows_; ++r) {
    for (int c = 0; c < n; ++c) {
      const float here = best_[static_cast<std::size_t>(r) * n + c];
      if (here < least_score) continue;
      bool top = true;
      for (int dr = -1; dr <= 1 && top; ++dr)
        for (int dc = -1; dc <= 1 && top; ++dc) {
          const int rr = r + dr, cc = c + dc;
          if ((dr == 0 && dc == 0) || rr < 0 || cc < 0 || rr >= small_rows_ || cc >= n) continue;
          const float there = best_[static_cast<std::size_t>(rr) * n + cc];
          // On a plateau the first pixel wins.
          top = dr < 0 || (dr == 0 && dc < 0) ? here > there : here >= there;
        }
      if (top) found.push_back({r, c, best_level_[static_cast<std::size_t>(r) * n + c], here});
    }
  }
  std::sort(found.begin(), found.end(), [](const Peak& a, const Peak& b) {
    return a.score != b.score ? a.score > b.score : a.row != b.row ? a.row < b.row : a.col < b.col;
  });
  std::vector<Peak> kept;
  for (const Peak& peak : found) {
    if (static_cast<int>(kept.size()) >= most) break;
    const bool apart = std::none_of(kept.begin(), kept.end(), [&](const Peak& other) {
      const double reach = 1.5 * std::max(scales_[other.level], scales_[peak.level]) / pool_;
      return std::hypot(peak.row - other.row, peak.col - other.col) < reach;
    });
    if (apart) kept.push_back(peak);
  }
  return kept;
}

// The centre of mass of the connected pixels above a share of the contrast, weighted by their height
// above that level, so that a pixel at the rim weighs nothing and noise there does no harm.
bool BlobFilter::refine(const float* image, const Peak& peak, double level, Blob& blob) {
  const std::size_t at = static_cast<std::size_t>(peak.row) * small_cols_ + peak.col;
  const double scale = scales_[peak.level];
  const float surround = levels_[scales_.size() - 1][at];
  const int row = std::min(peak.row * pool_ + pool_ / 2, rows_ - 1);
  const int col = std::min(peak.col * pool_ + pool_ / 2, cols_ - 1);
  const int reach = std::max(3, static_cast<int>(std::ceil(4 * scale)));
  const int r0 = std::max(0, row - reach), r1 = std::min(rows_, row + reach + 1);
  const int c0 = std::max(0, col - reach), c1 = std::min(cols_, col + reach + 1);
  const int near = std::max(pool_, static_cast<int>(std::ceil(scale)));
  int best = -1;
  for (int r = std::max(r0, row - near); r < std::min(r1, row + near + 1); ++r)
    for (int c = std::max(c0, col - near); c < std::min(c1, col + near + 1); ++c) {
      const int k = r * cols_ + c;
      if (mask_[k] && (best < 0 || image[k] > image[best])) best = k;
    }
  if (best < 0 || !(image[best] > surround)) return false;
  const float threshold = surround + static_cast<float>(level) * (image[best] - surround);

  const float floor = getenv("WS") ? surround : threshold;
  double sum = 0, su = 0, sv = 0, suu = 0, suv = 0, svv = 0;
  stack_.assign(1, best);
  seen_[best] = 1;
  for (std::size_t head = 0; head < stack_.size(); ++head) {
    const int k = stack_[head], r = k / cols_, c = k % cols_;
    const double w = image[k] - floor, u = c - col, v = r - row;
    sum += w, su += w * u, sv += w * v, suu += w * u * u, suv += w * u * v, svv += w * v * v;
    const int next[4][2] = {{r - 1, c}, {r + 1, c}, {r, c - 1}, {r, c + 1}};
    for (const auto& [rr, cc] : next) {
      if (rr < r0 || rr >= r1 || cc < c0 || cc >= c1) continue;
      const int j = rr * cols_ + cc;
      if (seen_[j] || !mask_[j] || !(image[j] > threshold)) continue;
      seen_[j] = 1;
      stack_.push_back(j);
    }
  }
  for (const int k : stack_) seen_[k] = 0;
  if (!(sum > 0)) return false;
  const double mu = su / sum, mv = sv / sum;
  blob = {col + mu, row + mv, peak.score, scale, image[best] - surround,
          suu / sum - mu * mu, suv / sum - mu * mv, svv / sum - mv * mv, static_cast<double>(stack_.size())};
  return true;
}

std::vector<Blob> BlobFilter::detect(const float* image, const BlobOptions& options) {
  pool_image(image);
  respond(options.least_contrast);
  std::vector<Blob> blobs;
  // Two peaks of one blob end at the same place; some more than asked for make up for them.
  for (const Peak& peak : peaks(options.least_score, 2 * options.count + 5)) {
    Blob blob;
    if (static_cast<int>(blobs.size()) == options.count) break;
    if (!refine(image, peak, options.level, blob)) continue;
    const bool apart = std::none_of(blobs.begin(), blobs.end(), [&](const Blob& other) {
      return std::hypot(blob.u - other.u, blob.v - other.v) < std::min(blob.scale, other.scale);
    });
    if (apart) blobs.push_back(blob);
  }
  return blobs;
}

}  // namespace sonocal
