// Consensus over minimal samples, with local optimisation. Knows nothing of points, lines or transforms.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/robust/random.hpp"

namespace sonocal {

struct ConsensusOptions {
  double confidence = 0.9999;
  int max_samples = 10000;
  int exhaustive_samples = 200;  // go through all combinations where they are no more than this
  std::uint64_t seed = 0;
};

// Units of one sample, the first of which are used.
using Sample = std::array<int, 7>;

template <class Model>
struct Consensus {
  Model model;
  double score = std::numeric_limits<double>::infinity();  // less is better
  int samples = 0;
};

// Units scored between two looks at the clock, which takes as long as scoring some ten of them.
inline constexpr int kUnitsALook = 16'384;

double combinations(int n, int k);
// The next combination of `size` out of n in lexicographic order; false after the last.
bool next_combination(Sample& sample, int size, int n);
// Samples after which one without outliers has been drawn, to the confidence asked for, if a share `clean`
// of all samples is without; between `fewest` and the most allowed.
double samples_needed(double clean, const ConsensusOptions& options);

// The model that the estimator scores best. The estimator is asked for
//
//   Model, Models                           the types of a model and of an array of a sample's models
//   int units(), int sample_size()          what is sampled, and how many make a sample
//   bool enumerable()                       whether a sample is determined by its units
//   void draw(Random&, Sample&)             a random sample
//   int solve(sample, Random&, models)      its models; returns how many
//   double score(model, enough)             less is better; may stop once it reaches `enough`
//   bool improve(model, score)              local optimisation, in place; false if it only made it worse
//   double clean_share(model)               of samples, those without outliers if it is right
//
// Samples end when one without outliers has been drawn with the confidence asked for, counting the inliers
// of the best model so far. A best model without any inlier ends nothing.
template <class Estimator>
Consensus<typename Estimator::Model> find_consensus(Estimator& estimator, const ConsensusOptions& options) {
  Consensus<typename Estimator::Model> best;
  const int n = estimator.units(), size = estimator.sample_size();
  if (n < size) return best;
  const bool all = estimator.enumerable() && combinations(n, size) <= options.exhaustive_samples;
  Random random(options.seed);
  Sample sample{0, 1, 2, 3, 4, 5, 6};
  typename Estimator::Models models;
  const int samples_a_look = std::max(1, kUnitsALook / n);
  double needed = all ? combinations(n, size) : options.max_samples;
  while (best.samples < needed) {
    if (++best.samples % samples_a_look == 0) allow_interrupt();
    if (!all) estimator.draw(random, sample);
    const int count = estimator.solve(sample, random, models);
    bool improved = false;
    for (int i = 0; i < count; ++i) {
      const double score = estimator.score(models[i], best.score);
      if (!(score < best.score)) continue;
      best.model = models[i];
      best.score = score;
      estimator.improve(best.model, best.score);
      improved = true;
    }
    if (all) {
      if (!next_combination(sample, size, n)) break;
    } else if (improved) {
      needed = samples_needed(estimator.clean_share(best.model), options);
    }
  }
  return best;
}

}  // namespace sonocal
