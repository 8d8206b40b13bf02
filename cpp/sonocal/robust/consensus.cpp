#include "sonocal/robust/consensus.hpp"

namespace sonocal {
namespace {

// Fewer samples than this prove nothing, whatever the share of inliers seems to be.
constexpr int kFewestSamples = 20;

}  // namespace

double combinations(int n, int k) {
  double count = 1;
  for (int i = 0; i < k; ++i) count *= static_cast<double>(n - i) / (i + 1);
  return std::round(count);
}

bool next_combination(Sample& sample, int size, int n) {
  for (int i = size - 1; i >= 0; --i) {
    if (sample[i] >= n - size + i) continue;
    ++sample[i];
    for (int j = i + 1; j < size; ++j) sample[j] = sample[j - 1] + 1;
    return true;
  }
  return false;
}

double samples_needed(double clean, const ConsensusOptions& options) {
  const double most = options.max_samples;
  if (!(clean > 0)) return most;
  const double needed = clean < 1 ? std::log1p(-options.confidence) / std::log1p(-clean) : 0;
  return std::clamp(needed, std::min<double>(kFewestSamples, most), most);
}

}  // namespace sonocal
