// The contract of find_consensus, with an estimator that counts what it is asked: a line y = m x through the
// origin, from one number a sample.
#include "check.hpp"
#include "sonocal/robust/consensus.hpp"

using namespace sonocal;

namespace {

constexpr double kTruth = 2.0;

struct Fake {
  using Model = double;
  using Models = std::array<double, 2>;

  std::array<double, 40> slopes{};  // of each unit
  int count = 40, size = 2;
  bool all = false, solvable = true;
  int drawn = 0, solved = 0, scored = 0, improved = 0, stopped_early = 0;

  int units() const { return count; }
  int sample_size() const { return size; }
  bool enumerable() const { return all; }
  void draw(Random& random, Sample& sample) {
    ++drawn;
    for (int i = 0; i < size; ++i) sample[i] = random.below(count);
  }
  int solve(const Sample& sample, Random&, Models& models) {
    ++solved;
    if (!solvable) return 0;
    models = {slopes[sample[0]], 1e9};  // the second is never any good
    return 2;
  }
  double score(double slope, double enough) {
    ++scored;
    double sum = 0;
    for (int i = 0; i < count; ++i) {
      sum += std::min(std::fabs(slopes[i] - slope), 1.0);
      if (sum >= enough) {
        ++stopped_early;
        break;
      }
    }
    return sum;
  }
  bool improve(double&, double&) {
    ++improved;
    return false;
  }
  double clean_share(double slope) {
    int agree = 0;
    for (int i = 0; i < count; ++i) agree += std::fabs(slopes[i] - slope) < 1.0;
    return std::pow(static_cast<double>(agree) / count, size);
  }
};

Fake with_outliers(int outliers) {
  Fake fake;
  for (int i = 0; i < fake.count; ++i) fake.slopes[i] = i < outliers ? 100.0 * (i + 1) : kTruth;
  return fake;
}

void all_combinations_once() {
  ConsensusOptions options;
  options.exhaustive_samples = 220;
  Fake fake = with_outliers(3);
  fake.count = 12;
  fake.size = 3;
  fake.all = true;
  const auto best = find_consensus(fake, options);
  check(fake.drawn == 0, "nothing is drawn where all combinations are tried");
  check(best.samples == 220 && fake.solved == 220, "12 choose 3 combinations are solved once each");
  check(best.model == kTruth, "the best of all combinations");
}

void random_samples_stop_when_sure() {
  ConsensusOptions options;
  options.confidence = 0.99;
  Fake fake = with_outliers(20);
  const auto best = find_consensus(fake, options);
  // ln(0.01) / ln(1 - 0.5^2) = 16.0, and never fewer than 20.
  check(best.samples == 20, "half outliers, two a sample: 20 samples");
  check(fake.drawn == best.samples && fake.solved == best.samples, "one draw and one solution a sample");
  check(fake.scored == 2 * best.samples, "every model is scored once");
  check(fake.stopped_early >= best.samples, "scoring stops once a model cannot win");
  check(fake.improved >= 1 && fake.improved <= best.samples, "only what wins is improved");
  check(best.model == kTruth && best.score == 20.0, "the truth wins");

  Fake harder = with_outliers(36);
  options.confidence = 0.999999;
  const auto found = find_consensus(harder, options);
  // ln(1e-6) / ln(1 - 0.1^2) = 1374.6
  check(found.samples == 1375, "nine outliers in ten: 1375 samples");
  check(found.model == kTruth, "and the truth");
}

void without_an_inlier_nothing_ends() {
  Fake fake = with_outliers(0);
  for (double& slope : fake.slopes) slope = 1e6 + 10.0 * (&slope - fake.slopes.data());
  ConsensusOptions options;
  options.max_samples = 300;
  struct NoInlier : Fake {
    double clean_share(double) { return 0.0; }
  } none;
  static_cast<Fake&>(none) = fake;
  check(find_consensus(none, options).samples == 300, "no inlier: all samples that are allowed");
}

void nothing_to_find() {
  Fake fake = with_outliers(0);
  fake.solvable = false;
  ConsensusOptions options;
  options.max_samples = 50;
  auto best = find_consensus(fake, options);
  check(best.samples == 50 && !std::isfinite(best.score), "no model, no score");
  fake.count = 1;
  best = find_consensus(fake, options);
  check(best.samples == 0 && !std::isfinite(best.score), "fewer units than a sample: nothing is tried");
}

void the_same_seed_draws_the_same() {
  for (const std::uint64_t seed : {0ull, 7ull}) {
    ConsensusOptions options;
    options.seed = seed;
    Fake first = with_outliers(25), second = with_outliers(25);
    find_consensus(first, options);
    find_consensus(second, options);
    check(first.scored == second.scored && first.stopped_early == second.stopped_early &&
              first.improved == second.improved,
          "the same seed, the same course");
  }
}

void counting() {
  check(combinations(50, 4) == 230300 && combinations(7, 7) == 1 && combinations(3, 4) == 0, "n choose k");
  Sample sample{0, 1, 2, 3, 4, 5, 6};
  int count = 1;
  while (next_combination(sample, 4, 9)) {
    ++count;
    for (int i = 1; i < 4; ++i) check(sample[i] > sample[i - 1] && sample[i] < 9, "rising and in range");
  }
  check(count == 126, "9 choose 4 combinations");
  const ConsensusOptions options{0.99, 1000, 0, 0};
  check(samples_needed(0, options) == 1000 && samples_needed(-1, options) == 1000,
        "zero inliers end nothing");
  check(samples_needed(1, options) == 20, "all inliers: the fewest that prove something");
}

}  // namespace

int main() {
  all_combinations_once();
  random_samples_stop_when_sure();
  without_an_inlier_nothing_ends();
  nothing_to_find();
  the_same_seed_draws_the_same();
  counting();
  return summary("the contract of consensus");
}
