#include "sonocal/study/trial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sonocal/estimate/refine.hpp"
#include "sonocal/estimate/white_residuals.hpp"
#include "sonocal/linalg/ldlt.hpp"

namespace sonocal {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kMostRefits = 20;
constexpr int kFewestRows = 4;  // eight equations for seven parameters

// RANSAC as the paper has it (section 9): hypotheses are compared as they are.
class PlainEstimator {
 public:
  using Model = Transform;
  using Models = std::array<Transform, Hypotheses::kMost>;

  PlainEstimator(const PointLines& rows, const Hypotheses& hypotheses, double limit)
      : rows_(rows), hypotheses_(hypotheses), limit_(limit) {}

  int units() const { return hypotheses_.units(); }
  int sample_size() const { return hypotheses_.sample_size(); }
  bool enumerable() const { return true; }
  void draw(Random& random, Sample& sample) const {
    for (int drawn = 0; drawn < sample_size();) {
      const int candidate = random.below(units());
      if (std::find(sample.begin(), sample.begin() + drawn, candidate) == sample.begin() + drawn)
        sample[drawn++] = candidate;
    }
  }
  int solve(const Sample& sample, Random&, Models& out) const { return hypotheses_.solve(sample, out); }
  double score(const Transform& a, double enough) const { return rows_.truncated_sum(a, limit_, enough); }
  bool improve(Transform&, double&) const { return false; }
  double clean_share(const Transform& a) const {
    PointLines::Column squares;
    rows_.squared_distances(a, squares);
    return std::pow(static_cast<double>((squares <= limit_).count()) / rows_.size(), sample_size());
  }

 private:
  const PointLines& rows_;
  const Hypotheses& hypotheses_;
  const double limit_;
};

// Refined on the rows that agree until those stay the same; on the nearest ones where too few agree.
Transform refined_on_agreeing(const PointLines& rows, const Transform& start, double limit) {
  Transform a = start;
  PointLines::Column squares, sorted;
  Eigen::Array<bool, Eigen::Dynamic, 1> before;
  for (int round = 0; round < kMostRefits; ++round) {
    rows.squared_distances(a, squares);
    double within = limit;
    if ((squares <= limit).count() < kFewestRows) {
      sorted = squares;
      std::nth_element(sorted.data(), sorted.data() + kFewestRows - 1, sorted.data() + sorted.size());
      within = sorted[kFewestRows - 1];
    }
    const Eigen::Array<bool, Eigen::Dynamic, 1> agreeing = squares <= within;
    if (round > 0 && (agreeing == before).all()) break;
    before = agreeing;
    const Refinement refined =
        refine(rows.geometric_cost(squares, within), a, Model::kSimilarity, kFinalIterations);
    if (ran_away(refined.transform, a)) break;
    a = refined.transform;
  }
  return a;
}

}  // namespace

TrialAnswer run_trial(const Table& table, const Method& method, const Options& options) {
  TrialAnswer answer;
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Sightings sightings = sightings_of(table);
  const Hypotheses hypotheses(method.solver, table.points, table.segments, rows, sightings);
  const Normalisation& units = rows.normalisation();
  const double limit = std::pow(options.threshold_mm / units.size, 2);
  PlainEstimator estimator(rows, hypotheses, limit);
  ConsensusOptions plain = options.consensus;
  plain.exhaustive_samples = 20;  // where a random search would take as many
  auto best = find_consensus(estimator, plain);
  if (std::isfinite(best.score)) {
    Transform start = best.model, all;
    PointLines::Column squares;
    rows.squared_distances(start, squares);
    if (hypotheses.solve_all(squares, limit, all) && rows.truncated_sum(all, limit, best.score) < best.score)
      start = all;
    answer.start = units.to_original(start);
    if (method.weighting == Weighting::kGeometric && rows.size() >= kFewestRows)
      answer.refined = units.to_original(refined_on_agreeing(rows, start, limit));
  }
  if (method.weighting == Weighting::kLikelihood) {
    Options whole = options;  // as calibrate() does it
    whole.weighting = Weighting::kLikelihood;
    whole.consensus = ConsensusOptions();
    whole.consensus.seed = options.consensus.seed;
    const Estimate found = estimate(table, whole);
    if (found.found) answer.refined = found.transform;
  }
  return answer;
}

Eigen::Matrix<double, 7, 7> cramer_rao_bound(const Table& table, const bool* sound, const Transform& truth,
                                             const Options& options) {
  using Matrix7 = Eigen::Matrix<double, 7, 7>;
  const WhiteResiduals white = white_residuals(table, sound, truth, options);
  Matrix7 information = Matrix7::Zero();
  for (Eigen::Index i = 0; i < white.jacobian.rows(); ++i) {
    const Eigen::Matrix<double, 7, 1> row = white.jacobian.row(i).transpose();
    information += row * row.transpose();
  }
  const Ldlt<7> factors(information);
  if (!(factors.least_pivot() > 0) || !information.allFinite()) return Matrix7::Constant(kNaN);
  return factors.solve<7>(Matrix7::Identity());
}

}  // namespace sonocal
