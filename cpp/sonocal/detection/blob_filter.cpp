#include "sonocal/detection/blob_filter.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/detection/gaussian_blur.hpp"
#include "sonocal/interrupt/interrupt.hpp"

namespace sonocal {
namespace {

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

constexpr float kStructure = 0.4f;        // of the contrast: above it lies what a peak belongs to
constexpr float kStructureValley = 0.7f;  // of the contrast: a deeper valley parts two structures
constexpr double kLongest = 1.0 / 6;  // of the image's smaller side: what is longer is no needle's section
constexpr double kSpare = 0.25;       // what a peak on such a structure still counts
constexpr double kSecond = 0.5;       // what the second reading of a merged echo counts
constexpr double kFar = 1.5;     // standard deviations of the cut echo, from its middle to the fitted one
constexpr double kCutShape = 9;  // a paraboloid's shape over the second moment of its part above half
constexpr double kUsualContrast = 75;  // grey levels; speckle that stands out of even speckle has less
constexpr int kPeaksTried = 50;        // and four a candidate asked for

// Two peaks of one blob end at the same place.
bool apart(const std::vector<Blob>& blobs, const Blob& blob) {
  return std::none_of(blobs.begin(), blobs.end(), [&](const Blob& other) {
    return std::hypot(blob.u - other.u, blob.v - other.v) < std::min(blob.scale, other.scale);
  });
}

}  // namespace

BlobFilter::BlobFilter(const unsigned char* mask, int rows, int cols, std::vector<double> scales, int pool)
    : rows_(rows),
      cols_(cols),
      pool_(pool),
      small_rows_((rows + pool - 1) / pool),
      small_cols_((cols + pool - 1) / pool),
      longest_(kLongest * std::min(rows, cols)),
      scales_(std::move(scales)),
      mask_(mask, mask + static_cast<std::size_t>(rows) * cols),
      seen_(mask_.size(), 0),
      taken_(mask_.size(), 0) {
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
    steps_.push_back(std::sqrt(sigma * sigma - before * before));
    before = sigma;
    blur(values, steps_.back());
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

// Outside the image there is nothing, which the normaliser undoes.
void BlobFilter::blur(std::vector<float>& values, double sigma) {
  gaussian_blur(values, scratch_, small_rows_, small_cols_, sigma);
}

void BlobFilter::respond(double least_contrast) {
  const std::size_t size = best_.size();
  std::vector<float>& running = pooled_;
  for (std::size_t i = 0; i < scales_.size(); ++i) {
    allow_interrupt();
    blur(running, steps_[i]);
    const float* normaliser = normalisers_[i].data();
    for (std::size_t k = 0; k < size; ++k) levels_[i][k] = running[k] * normaliser[k];
  }
  std::fill(best_.begin(), best_.end(), 0.0f);
  for (std::size_t i = 0; i + 1 < scales_.size(); ++i) {
    for (std::size_t k = 0; k < size; ++k) scratch_[k] = levels_[i][k] - levels_[i + 1][k];
    // A floor for images without noise: grey levels are rounded, and at wider scales the less of it is left.
    // 1.48 median |x| is a normal deviate's standard deviation, deaf to the few bright places.
    const float noise = std::max(1.4826f * median_magnitude(scratch_, weight_),
                                 static_cast<float>(least_contrast * scales_.front() / scales_[i]));
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
      const int level = best_level_[static_cast<std::size_t>(r) * n + c];
      if (top) found.push_back({r, c, level, here});
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

// The hill around a pixel: connected pixels above a threshold, reached without climbing more than `rise`
// from the lowest pixel on the way. A valley as deep as that parts an echo from its reverberations.
void BlobFilter::grow(const float* image, int start, float threshold, float rise, const Box& box) {
  hill_.assign(1, {start, image[start]});
  seen_[start] = 1;
  for (std::size_t head = 0; head < hill_.size(); ++head) {
    const auto [k, low] = hill_[head];
    const int r = k / cols_, c = k % cols_;
    const int next[4][2] = {{r - 1, c}, {r + 1, c}, {r, c - 1}, {r, c + 1}};
    for (const auto& [rr, cc] : next) {
      if (rr < box.r0 || rr >= box.r1 || cc < box.c0 || cc >= box.c1) continue;
      const int j = rr * cols_ + cc;
      if (seen_[j] || !mask_[j] || !(image[j] > threshold) || image[j] > low + rise) continue;
      seen_[j] = 1;
      hill_.push_back({j, std::min(low, image[j])});
    }
  }
  for (const auto& [k, low] : hill_) seen_[k] = 0;
}

// The brightest pixel near a peak of the pooled responses, and how far it stands out.
BlobFilter::Summit BlobFilter::summit(const float* image, const Peak& peak) const {
  const double scale = scales_[peak.level];
  const int row = std::min(peak.row * pool_ + pool_ / 2, rows_ - 1);
  const int col = std::min(peak.col * pool_ + pool_ / 2, cols_ - 1);
  const int near = std::max(pool_, static_cast<int>(std::ceil(scale)));
  int best = -1;
  for (int r = std::max(0, row - near); r < std::min(rows_, row + near + 1); ++r)
    for (int c = std::max(0, col - near); c < std::min(cols_, col + near + 1); ++c) {
      const int k = r * cols_ + c;
      if (mask_[k] && (best < 0 || image[k] > image[best])) best = k;
    }
  const float surround = levels_.back()[static_cast<std::size_t>(peak.row) * small_cols_ + peak.col];
  return {best, surround, best < 0 ? 0.0f : image[best] - surround};
}

BlobFilter::Box BlobFilter::box_around(int pixel, double reach) const {
  const int r = pixel / cols_, c = pixel % cols_, n = std::max(3, static_cast<int>(std::ceil(reach)));
  return {std::max(0, r - n), std::min(rows_, r + n + 1), std::max(0, c - n), std::min(cols_, c + n + 1)};
}

// The structure that a peak belongs to, marked as taken: a layer, a vessel's wall or an oblique needle has
// peaks all along and would otherwise fill the list. Returns its length, px, as far as it was followed.
double BlobFilter::claim(const float* image, const Summit& top) {
  grow(image, top.pixel, top.surround + kStructure * top.contrast, kStructureValley * top.contrast,
       box_around(top.pixel, longest_));
  for (const auto& [k, low] : hill_) {
    if (!taken_[k]) marked_.push_back(k);
    taken_[k] = 1;
  }
  Blob whole;
  measure(image, top.surround, whole);
  const double mean = 0.5 * (whole.uu + whole.vv), half = std::hypot(0.5 * (whole.uu - whole.vv), whole.uv);
  return 4 * std::sqrt(std::max(0.0, mean + half));
}

// The middle of the echo: that of the paraboloid through what is bright, or the centre of mass.
Blob BlobFilter::refine(const float* image, const Peak& peak, const Summit& top, const BlobOptions& options) {
  Blob blob;
  grow(image, top.pixel, static_cast<float>(top.surround + options.level * top.contrast),
       static_cast<float>(options.split * top.contrast), box_around(top.pixel, 0.5 * longest_));
  measure(image, top.surround, blob);
  if (options.first_echo) place_first_echo(image, top, blob);
  const double share = top.contrast / kUsualContrast;
  blob.score = peak.score * (share < 1 ? share * share : std::sqrt(share));
  blob.scale = scales_[peak.level];
  blob.contrast = top.contrast;
  return blob;
}

void BlobFilter::place_first_echo(const float* image, const Summit& top, Blob& blob) {
  const int row = top.pixel / cols_, col = top.pixel % cols_;
  echo_.clear();
  for (const auto& [k, low] : hill_)
    echo_.push_back({static_cast<double>(k % cols_ - col), static_cast<double>(k / cols_ - row), image[k]});
  const EchoFit fit = fit_echo(echo_, top.contrast, scales_.front());
  const double u = col + fit.u, v = row + fit.v;
  // An extrapolated top that lies outside of what was fitted is none.
  const bool near = std::pow(u - blob.u, 2) <= kFar * kFar * (blob.uu + 1) &&
                    std::pow(v - blob.v, 2) <= kFar * kFar * (blob.vv + 1);
  if (!fit.found || !near) {
    // Too small or too uneven for a paraboloid.
    const BlobOptions half;
    grow(image, top.pixel, static_cast<float>(top.surround + half.level * top.contrast),
         static_cast<float>(half.split * top.contrast), box_around(top.pixel, 0.5 * longest_));
    measure(image, top.surround, blob);
    blob.uu *= kCutShape, blob.uv *= kCutShape, blob.vv *= kCutShape;
    return;
  }
  blob.u = u, blob.v = v, blob.deeper = fit.deeper;
  blob.uu = top.contrast * fit.uu, blob.uv = top.contrast * fit.uv, blob.vv = top.contrast * fit.vv;
}

// Centre and moments of the hill, weighted by height above the surround.
void BlobFilter::measure(const float* image, float surround, Blob& blob) const {
  const int row = hill_[0].first / cols_, col = hill_[0].first % cols_;
  double sum = 0, su = 0, sv = 0, suu = 0, suv = 0, svv = 0;
  for (const auto& [k, low] : hill_) {
    const double w = image[k] - surround, u = k % cols_ - col, v = k / cols_ - row;
    sum += w, su += w * u, sv += w * v, suu += w * u * u, suv += w * u * v, svv += w * v * v;
  }
  const double mu = su / sum, mv = sv / sum;
  blob.u = col + mu;
  blob.v = row + mv;
  blob.uu = suu / sum - mu * mu;
  blob.uv = suv / sum - mu * mv;
  blob.vv = svv / sum - mv * mv;
  blob.area = static_cast<double>(hill_.size());
}

std::vector<Blob> BlobFilter::detect(const float* image, const BlobOptions& options) {
  pool_image(image);
  respond(options.least_contrast);
  std::vector<Blob> blobs;
  for (const Peak& peak : peaks(options.least_score, kPeaksTried + 4 * options.count)) {
    const Summit top = summit(image, peak);
    if (top.pixel < 0 || !(top.contrast > 0) || taken_[top.pixel]) continue;
    const double length = claim(image, top);
    Blob blob = refine(image, peak, top, options);
    if (length > longest_) blob.score *= kSpare;
    if (!apart(blobs, blob)) continue;
    blobs.push_back(blob);
    if (blob.deeper > 0) {
      // Behind what stands for itself about as clearly, so that it takes nobody's place.
      blob.v += blob.deeper, blob.score *= kSecond;
      blobs.push_back(blob);
    }
  }
  for (const int k : marked_) taken_[k] = 0;
  marked_.clear();
  std::stable_sort(blobs.begin(), blobs.end(),
                   [](const Blob& a, const Blob& b) { return a.score > b.score; });
  blobs.resize(std::min<std::size_t>(blobs.size(), options.count));
  return blobs;
}

}  // namespace sonocal
