#include "sonocal/estimate/stretch.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

namespace sonocal {
namespace {

// Fewer frames say nothing of how they repeat one another; fewer stretches nothing of their variance.
constexpr int kFewestFrames = 16, kFewestStretches = 4;

// The mean residual of each frame in the order of frames, less the mean of all.
std::vector<Eigen::Vector3d> frame_means(const double* residuals, const std::int32_t* frames, int rows) {
  std::vector<int> order(rows);
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return frames[a] < frames[b]; });
  std::vector<Eigen::Vector3d> means;
  for (int begin = 0, end; begin < rows; begin = end) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (end = begin; end < rows && frames[order[end]] == frames[order[begin]]; ++end)
      sum += Eigen::Map<const Eigen::Vector3d>(residuals + 3 * order[end]);
    means.push_back(sum / (end - begin));
  }
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& mean : means) centre += mean;
  centre /= static_cast<double>(means.size());
  for (Eigen::Vector3d& mean : means) mean -= centre;
  return means;
}

double correlation(const std::vector<Eigen::Vector3d>& means, std::size_t lag) {
  double sum = 0;
  for (std::size_t i = lag; i < means.size(); ++i) sum += means[i].dot(means[i - lag]);
  return sum;
}

}  // namespace

int stretch_length(const double* residuals, const std::int32_t* frames, int rows) {
  if (rows < kFewestFrames) return 1;
  const std::vector<Eigen::Vector3d> means = frame_means(residuals, frames, rows);
  const auto count = static_cast<int>(means.size());
  const double power = correlation(means, 0);
  if (count < kFewestFrames || !(power > 0)) return 1;
  // Three vector components make chance correlations of some 1 / sqrt(2 frames).
  const double insignificant = 3 / std::sqrt(2.0 * count);
  double length = 1;
  for (int lag = 1; lag < count / 2; ++lag) {
    const double share = correlation(means, lag) / power;
    if (!(share >= insignificant)) break;
    length += 2 * share;
  }
  return static_cast<int>(std::min(std::ceil(length), static_cast<double>(count / kFewestStretches)));
}

}  // namespace sonocal
