#include "sonocal/correspondences/correspondences.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sonocal/correspondences/descent.hpp"
#include "sonocal/correspondences/mixed_samples.hpp"
#include "sonocal/solvers/gauss_newton.hpp"

namespace sonocal {
namespace {

constexpr int kCandidateSteps = 6, kLocalRounds = 6, kLocalSteps = 2, kFinalRounds = 20, kFinalSteps = 30;
constexpr int kFewestRows = 7, kSettlingRounds = 4;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kLittle = 1e-2, kAtRest = 1e-9;  // parts of a score

class Estimator {
 public:
  using Model = Transform;
  using Models = MixedSamples::Models;

  Estimator(const Correspondences& all, const CorrespondenceOptions& options)
      : all_(all),
        options_(options),
        limit_(options.threshold * options.threshold),
        rows_(all),
        scaled_limit_(limit_ / (rows_.size() * rows_.size())),
        scale_(options.fixed_scale * rows_.source_size() / rows_.size()),
        samples_(rows_, options.weights, scale_) {}

  int units() const { return rows_.units(); }
  int sample_size() const { return 1; }  // what holds seven motions differs from sample to sample
  bool enumerable() const { return false; }
  void draw(Random& random, Sample&) { samples_.draw(random); }
  int solve(const Sample&, Random&, Models& out) {
    const int count = samples_.solve(out);
    return scale_ == 0 || samples_.at_scale() ? count : refine_on_sample(out.data(), count);
  }

  double score(const Transform& a, double enough) {
    const double score = rows_.truncated_sum(a, scaled_limit_, enough);
    return score < enough && !samples_.determine(a) ? kInfinity : score;
  }
  double clean_share(const Transform& a) {
    rows_.squares(a, squares_);
    return samples_.clean_share(rows_.shares_within(squares_, scaled_limit_));
  }

  // A solution leaves some of its sample's rows out: first it is fitted to them all.
  bool improve(Transform& a, double& score) {
    Transform next = a;
    if (refine_on_sample(&next, 1) == 1) keep_better(next, a, score);
    return optimise(a, score, kLocalRounds, kLocalSteps, kLittle);
  }

  // Refined on the correspondences that agree until it and they come to rest, in the table's own numbers;
  // true if they did.
  bool settle(Transform& a, double& score) {
    optimise(a, score, kFinalRounds, kFinalSteps, kAtRest);
    for (int round = 0; round < kSettlingRounds && look_around(a, score); ++round) continue;
    a = rows_.to_original(a);
    const auto rows = rows_of(agreeing(a));
    const int count = static_cast<int>(rows.size());
    const double before = squared_residuals(rows.data(), count, a);
    const double after = gauss_newton(rows.data(), count, kFinalSteps, options_.fixed_scale, a);
    return before - after <= kAtRest * before + 1e-24;
  }
  Transform to_original(const Transform& a) const { return rows_.to_original(a); }

  std::vector<int> agreeing(const Transform& a) const {
    std::vector<int> out;
    for (int c = 0; c < all_.count; ++c)
      if (square(a, c) <= limit_) out.push_back(c);
    return out;
  }
  // Mean squared distance of the correspondence's points.
  double square(const Transform& a, int c) const {
    int points = 0;
    double sum = 0;
    for (int i = all_.first[c]; i < all_.first[c + 1]; ++i) {
      const PointOnPlane row = read_row(all_.points, all_.planes, i);
      points += i == all_.first[c] ||
                !std::equal(all_.points + 3 * i, all_.points + 3 * i + 3, all_.points + 3 * (i - 1));
      sum += squared_residuals(&row, 1, a);
    }
    return sum / points;
  }

 private:
  int refine_on_sample(Transform* candidates, int count) {
    const auto& rows = samples_.rows();
    return refine_candidates(rows.data(), static_cast<int>(rows.size()), kCandidateSteps, scale_, candidates,
                             count);
  }

  bool keep_better(const Transform& next, Transform& a, double& score) const {
    const double next_score = rows_.truncated_sum(next, scaled_limit_, kInfinity);
    if (!(next_score < score)) return false;
    a = next;
    score = next_score;
    return true;
  }

  // Rows of the table, weighed.
  std::vector<PointOnPlane> rows_of(const std::vector<int>& chosen) const {
    std::vector<PointOnPlane> out;
    for (const int c : chosen)
      for (int i = all_.first[c]; i < all_.first[c + 1]; ++i) {
        const PointOnPlane row = read_row(all_.points, all_.planes, i);
        const double weight = options_.weights ? options_.weights[c] : 1.0;
        out.push_back({row.point, weight * row.normal, weight * row.offset});
      }
    return out;
  }

  // Fitted to what is within the limit; false where that is less than seven rows, or holds the same as
  // `known`.
  bool refit(Transform& a, double limit, int steps, int known = -1) {
    rows_.squares(a, squares_);
    const int rows = rows_.rows_within(squares_, limit);
    if (rows < kFewestRows || rows == known) return false;
    descend(rows_.cost(squares_, limit), steps, scale_ > 0, a);
    return true;
  }

  // Refines on what agrees, again and again, while it lowers the score by more than a part of it.
  bool optimise(Transform& a, double& score, int rounds, int steps, double little) {
    bool improved = false;
    for (int round = 0; round < rounds; ++round) {
      Transform next = a;
      const double before = score;
      if (!refit(next, scaled_limit_, steps) || !keep_better(next, a, score)) break;
      improved = true;
      if (before - score <= little * before) break;
    }
    return improved;
  }

  // A correspondence near the threshold makes two fits stable: what is within half and twice the threshold
  // leads to the better one.
  bool look_around(Transform& a, double& score) {
    rows_.squares(a, squares_);
    const int known = rows_.rows_within(squares_, scaled_limit_);
    for (const double factor : {0.25, 4.0}) {
      Transform next = a;
      if (!refit(next, factor * scaled_limit_, kLocalSteps, known)) continue;
      double next_score = rows_.truncated_sum(next, scaled_limit_, kInfinity);
      optimise(next, next_score, kFinalRounds, kFinalSteps, kAtRest);
      if (!(next_score < (1 - kAtRest) * score)) continue;
      a = next;
      score = next_score;
      return true;
    }
    return false;
  }

  const Correspondences& all_;
  const CorrespondenceOptions& options_;
  const double limit_;
  UnitRows rows_;
  const double scaled_limit_, scale_;  // of the rows' coordinates
  MixedSamples samples_;
  UnitRows::Column squares_;
};

}  // namespace

CorrespondenceEstimate estimate(const Correspondences& correspondences,
                                const CorrespondenceOptions& options) {
  Estimator estimator(correspondences, options);
  CorrespondenceEstimate result;
  auto best = find_consensus(estimator, options.consensus);
  result.samples = best.samples;
  result.found = std::isfinite(best.score);
  if (!result.found) return result;
  if (options.refine)
    result.converged = estimator.settle(best.model, best.score);
  else
    best.model = estimator.to_original(best.model);
  result.transform = best.model;
  result.inliers = static_cast<int>(estimator.agreeing(best.model).size());
  for (int c = 0; c < correspondences.count; ++c) result.squares.push_back(estimator.square(best.model, c));
  return result;
}

}  // namespace sonocal
