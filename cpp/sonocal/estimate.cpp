#include "sonocal/estimate.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace sonocal {
namespace {

using Column = PointLines::Column;
using Agreeing = Eigen::Array<bool, Eigen::Dynamic, 1>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kLocalRounds = 4;
constexpr int kLocalIterations = 1;
constexpr int kFinalRounds = 20;
constexpr int kFinalIterations = 60;
constexpr double kLittle = 1e-2;  // part of a score
constexpr int kLikelihoodRounds = 4;
// A consensus is as clear among this many rows as among a million.
constexpr int kMostConsensusRows = 4000;
constexpr int kAutoSamples = 300;
// Squared distances of sound rows are sigma^2 times a chi-squared variable of two degrees of freedom.
constexpr double kChi2Median = 1.386, kChi2Most = 10.6;  // 50 %, 99.5 %

Sightings sightings_of(const Table& table) {
  return table.sightings ? Sightings::of_codes(table.sightings, table.rows)
                         : Sightings::single_rows(table.rows);
}

// Scores transforms by sum min(distance^2, threshold^2) (MSAC, Torr and Zisserman 2000): among the scores
// tried it was never worse than the count of inliers and needs no noise level.
template <class Sampler>
class PointLineEstimator {
 public:
  using Model = Transform;
  using Models = Candidates;

  PointLineEstimator(const PointLines& rows, Sampler& sampler, sonocal::Model model, double limit)
      : rows_(rows), sampler_(sampler), model_(model), limit_(limit) {}

  int units() const { return sampler_.units(); }
  int sample_size() const { return sampler_.sample_size(); }
  bool enumerable() const { return sampler_.enumerable(); }
  void draw(Random& random, Sample& sample) { sampler_.draw(random, sample); }
  int solve(const Sample& sample, Random& random, Candidates& out) {
    return sampler_.solve(sample, random, out);
  }
  double score(const Transform& a, double enough) const { return rows_.truncated_sum(a, limit_, enough); }
  bool improve(Transform& a, double& score) {
    return optimise(a, score, kLocalRounds, kLocalIterations, kLittle).improved;
  }
  double inlier_share(const Transform& a) {
    rows_.squared_distances(a, squares_);
    return static_cast<double>((squares_ <= limit_).count()) / rows_.size();
  }

  // To the bottom: refined to convergence, and not stuck where a row near the threshold makes two fits
  // stable. Refitting from the rows within half and twice the threshold finds the better one, whatever the
  // samples happened to be. True if it came to rest.
  bool settle(Transform& a, double& score) {
    bool converged = optimise(a, score, kFinalRounds, kFinalIterations, 0).converged;
    for (int round = 0, improved = 1; improved && round < kLocalRounds; ++round) {
      improved = 0;
      rows_.squared_distances(a, squares_);
      const Agreeing own = squares_ <= limit_;
      for (const double factor : {0.25, 4.0}) {
        if (((squares_ <= factor * limit_) == own).all()) continue;
        Transform other = refit(a, factor * limit_, kLocalIterations).transform;
        rows_.squared_distances(other, squares_);
        if (((squares_ <= limit_) == own).all()) {  // from the same rows to the same fit
          rows_.squared_distances(a, squares_);
          continue;
        }
        double other_score = this->score(other, kInfinity);
        const bool at_rest = optimise(other, other_score, kFinalRounds, kFinalIterations, 0).converged;
        if (other_score < score) {
          a = other;
          score = other_score;
          converged = at_rest;
          improved = 1;
        }
        rows_.squared_distances(a, squares_);
        if (improved) break;
      }
    }
    return converged;
  }

 private:
  struct Optimised {
    bool improved, converged;
  };

  // Refines on the rows that agree, again and again, while it lowers the score by more than a part of it and
  // other rows agree then.
  Optimised optimise(Transform& a, double& score, int rounds, int iterations, double little) {
    Optimised result{false, false};
    for (int round = 0; round < rounds; ++round) {
      const Refinement refined = refit(a, limit_, iterations);
      const Agreeing before = squares_ <= limit_;
      const double next = this->score(refined.transform, kInfinity);
      result.converged = refined.converged;
      if (next > score) break;
      const bool much = next < (1 - little) * score;
      result.improved = result.improved || next < score;
      a = refined.transform;
      score = next;
      if (!much) break;
      rows_.squared_distances(a, squares_);
      if (refined.converged && ((squares_ <= limit_) == before).all()) break;
    }
    return result;
  }

  Refinement refit(const Transform& a, double limit, int iterations) {
    rows_.squared_distances(a, squares_);
    // A minimal solver leaves one of its equations out, and with noise the row may miss by more than the
    // threshold: where fewer rows agree than determine the model, the nearest ones do.
    const int needed = parameter_count(model_) / 2 + 1;
    if (rows_.size() < needed) return {a, 0, 0, false};
    if ((squares_ <= limit).count() < needed) limit = nearest(needed);
    const Refinement refined = refine(rows_.geometric_cost(squares_, limit), a, model_, iterations);
    return ran_away(refined.transform, a) ? Refinement{a, 0, 0, false} : refined;
  }

  // The n-th smallest squared distance.
  double nearest(int n) const {
    Column sorted = squares_;
    std::nth_element(sorted.data(), sorted.data() + n - 1, sorted.data() + sorted.size());
    return sorted[n - 1];
  }

  const PointLines& rows_;
  Sampler& sampler_;
  const sonocal::Model model_;
  const double limit_;
  Column squares_;
};

// Median squared distance over random samples' best transform: the noise, while most rows are sound.
template <class Sampler>
double limit_from_noise(const PointLines& rows, Sampler& sampler, std::uint64_t seed) {
  Random random(seed);
  Sample sample;
  Candidates candidates;
  Column squares;
  double least = kInfinity;
  if (sampler.units() < sampler.sample_size()) return least;
  for (int i = 0; i < kAutoSamples; ++i) {
    sampler.draw(random, sample);
    const int count = sampler.solve(sample, random, candidates);
    for (int k = 0; k < count; ++k) {
      rows.squared_distances(candidates[k], squares);
      std::nth_element(squares.data(), squares.data() + squares.size() / 2, squares.data() + squares.size());
      least = std::min(least, squares[squares.size() / 2]);
    }
  }
  return least * kChi2Most / kChi2Median;
}

struct Start {
  Transform transform;
  double limit;
  int samples = 0;
  bool found = false;
  bool converged = false;
};

template <class Sampler>
Start consensus_with(const PointLines& rows, Sampler sampler, const Options& options) {
  Start start;
  const bool automatic = !(options.threshold_mm > 0);
  start.limit = automatic ? limit_from_noise(rows, sampler, options.consensus.seed)
                          : std::pow(options.threshold_mm / rows.normalisation().size, 2);
  // A limit from minimal samples is their own error's; the refined answer's is nearer to the noise.
  for (int round = 0; round < (automatic ? 2 : 1); ++round) {
    PointLineEstimator<Sampler> estimator(rows, sampler, options.model, start.limit);
    auto best = find_consensus(estimator, options.consensus);
    start.samples += best.samples;
    start.found = std::isfinite(best.score);
    if (!start.found) return start;
    start.converged = estimator.settle(best.model, best.score);
    start.transform = best.model;
    if (automatic && round == 0) {
      Column squares;
      rows.squared_distances(best.model, squares);
      std::nth_element(squares.data(), squares.data() + squares.size() / 2, squares.data() + squares.size());
      start.limit = std::max(squares[squares.size() / 2] * kChi2Most / kChi2Median, 1e-24);
    }
  }
  return start;
}

Start consensus_of(const PointLines& rows, const Sightings& sightings, const Labels& labels,
                   const Options& options) {
  return rows.dimension() == 2 ? consensus_with(rows, FourRows(rows, labels), options)
                               : consensus_with(rows, TwoSightings(rows, sightings), options);
}

// Every n-th sighting of a large table, as a table of its own.
struct Thinned {
  std::vector<double> points, segments;
  std::vector<std::int32_t> sightings, frame, target;

  Thinned(const Table& table, const Sightings& groups) {
    const int step = 1 + table.rows / kMostConsensusRows;
    for (int group = 0, code = 0; group < groups.size(); group += step, ++code)
      for (const int row : groups[group]) {
        points.insert(points.end(), table.points + 3 * row, table.points + 3 * row + 3);
        segments.insert(segments.end(), table.segments + 6 * row, table.segments + 6 * row + 6);
        sightings.push_back(code);
        if (table.labels.frame) frame.push_back(table.labels.frame[row]);
        if (table.labels.target) target.push_back(table.labels.target[row]);
      }
  }
  Labels labels() const {
    return {frame.empty() ? nullptr : frame.data(), target.empty() ? nullptr : target.data()};
  }
};

Start start_of(const Table& table, const PointLines& rows, const Sightings& sightings,
               const Options& options) {
  if (table.rows <= 2 * kMostConsensusRows) return consensus_of(rows, sightings, table.labels, options);
  const Thinned thinned(table, sightings);
  const int count = static_cast<int>(thinned.sightings.size());
  const PointLines few(thinned.points.data(), thinned.segments.data(), count, table.dimension);
  Start start =
      consensus_of(few, Sightings::of_codes(thinned.sightings.data(), count), thinned.labels(), options);
  if (!start.found) return start;
  const double ratio = few.normalisation().size / rows.normalisation().size;
  start.limit *= ratio * ratio;
  start.transform = rows.normalisation().to_normalised(few.normalisation().to_original(start.transform));
  Column squares;
  rows.squared_distances(start.transform, squares);
  const Refinement refined =
      refine(rows.geometric_cost(squares, start.limit), start.transform, options.model, kFinalIterations);
  start.transform = refined.transform;
  start.converged = refined.converged;
  return start;
}

// The tangent's map from normalised to original coordinates: the rotation turns about the image's
// centre there and about its origin here, so a turn and a growth move the origin too.
TangentMatrix tangent_to_original(const Transform& original, const Normalisation& normalisation,
                                  Model model) {
  const int k = parameter_count(model);
  const Matrix3d s = original.linear();
  const Vector3d centre = normalisation.image_centre;
  TangentMatrix map = TangentMatrix::Identity(k, k);
  map.block<3, 3>(3, 0) = cross_matrix(s * centre);
  map.block<3, 3>(3, 3) *= normalisation.size;
  if (model == Model::kSimilarity)
    map.block<3, 1>(3, 6) = -s * centre;
  else
    for (int axis = 0; axis < 2; ++axis) map.block<3, 1>(3, 6 + axis) = -s.col(axis) * centre[axis];
  return map;
}

// Fills in what follows from the normalised transform: the rows with squares <= limit are its inliers.
class Reporter {
 public:
  Reporter(const PointLines& rows, const Options& options) : rows_(rows), options_(options) {}

  void operator()(const Transform& normalised, const Column& squares, double limit,
                  const std::optional<LikelihoodFit>& likelihood, Estimate& result) const {
    const Normalisation& n = rows_.normalisation();
    const int k = parameter_count(options_.model);
    const NormalEquations equations = rows_.geometric_cost(squares, limit);
    const TangentMatrix geometric = equations.information(normalised, options_.model);
    result.inliers = equations.rows();
    result.least_information = Eigen::SelfAdjointEigenSolver<TangentMatrix>(geometric).eigenvalues()[0] /
                               std::max(result.inliers, 1);
    result.transform = n.to_original(normalised);
    rows_.squared_distances(normalised, result.squares);
    result.squares *= n.size * n.size;
    result.covariance = TangentMatrix::Constant(k, k, std::numeric_limits<double>::quiet_NaN());
    result.found = true;
    if (!(result.least_information > 0)) return;
    const TangentMatrix map = tangent_to_original(result.transform, n, options_.model);
    const TangentMatrix inverse = likelihood ? TangentMatrix(likelihood->information.inverse())
                                             : TangentMatrix(geometric.inverse() / (n.size * n.size));
    result.covariance = map * inverse * map.transpose();
    if (likelihood) result.levels = likelihood->levels;
  }

 private:
  const PointLines& rows_;
  const Options& options_;
};

// Weighted refinement, and again where it changed which rows agree.
LikelihoodFit weigh(const PointLines& rows, const Sightings& sightings, const RowNoise& noise, Start& start,
                    const Options& options, Column& squares) {
  const NoiseModel model(rows, sightings, noise);
  LikelihoodFit fit;
  int agreeing = -1;
  for (int round = 0; round < kLikelihoodRounds; ++round) {
    rows.squared_distances(start.transform, squares);
    const int now = static_cast<int>((squares <= start.limit).count());
    if (now == agreeing) break;
    agreeing = now;
    fit = maximise_likelihood(model, squares, start.limit, start.transform, options.model, options.levels);
    start.transform = fit.transform;
  }
  rows.squared_distances(start.transform, squares);
  return fit;
}

}  // namespace

Estimate estimate(const Table& table, const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Sightings sightings = sightings_of(table);
  Estimate result;
  Start start = start_of(table, rows, sightings, options);
  result.samples = start.samples;
  result.threshold_mm = std::sqrt(start.limit) * rows.normalisation().size;
  if (!start.found) return result;
  Column squares;
  rows.squared_distances(start.transform, squares);
  std::optional<LikelihoodFit> fit;
  result.converged = start.converged;
  if (options.weighting == Weighting::kLikelihood &&
      2 * (squares <= start.limit).count() > parameter_count(options.model)) {
    fit = weigh(rows, sightings, table.noise, start, options, squares);
    result.converged = fit->converged;
  }
  Reporter(rows, options)(start.transform, squares, start.limit, fit, result);
  return result;
}

Estimate refine_chosen(const Table& table, const bool* chosen, const Transform& start,
                       const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Sightings sightings = sightings_of(table);
  Column selector(table.rows);
  for (int i = 0; i < table.rows; ++i) selector[i] = chosen[i] ? 0.0 : 1.0;
  constexpr double kChosen = 0.5;
  Estimate result;
  std::optional<LikelihoodFit> fit;
  Transform refined = rows.normalisation().to_normalised(start);
  const Refinement geometric =
      refine(rows.geometric_cost(selector, kChosen), refined, options.model, kFinalIterations);
  if (!ran_away(geometric.transform, refined)) {
    refined = geometric.transform;
    result.converged = geometric.converged;
  }
  if (options.weighting == Weighting::kLikelihood) {
    fit = maximise_likelihood(NoiseModel(rows, sightings, table.noise), selector, kChosen, refined,
                              options.model, options.levels);
    refined = fit->transform;
    result.converged = fit->converged;
  }
  Reporter(rows, options)(refined, selector, kChosen, fit, result);
  return result;
}

namespace {

template <int kParameters>
WhiteResiduals whiten(const Table& table, const bool* chosen, const Transform& at, const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Sightings sightings = sightings_of(table);
  const Normalisation& n = rows.normalisation();
  const Transform normalised = n.to_normalised(at);
  const Matrix3d s = normalised.linear();
  const TangentMatrix from_original = tangent_to_original(at, n, options.model).inverse();
  Column selector(table.rows);
  for (int i = 0; i < table.rows; ++i) selector[i] = chosen[i] ? 0.0 : 1.0;
  const int count = 2 * static_cast<int>((selector < 0.5).count());
  const NoiseModel noise(rows, sightings, table.noise);
  const double a = std::pow(options.levels.px / n.image_size, 2), b = std::pow(options.levels.mm / n.size, 2);
  const bool alike = options.weighting == Weighting::kGeometric;

  WhiteResiduals out;
  out.jacobian.resize(count, kParameters);
  out.shift.resize(count, 3);
  out.residual.resize(count);
  out.row.reserve(count);
  std::vector<IndependentRow> independent;
  int to = 0;
  for (int i = 0; i < sightings.size(); ++i) {
    if (alike)
      noise.alike_rows(i, selector, 0.5, independent);
    else
      noise.independent_rows(i, normalised, selector, 0.5, independent);
    for (const IndependentRow& row : independent)
      for (int k = 0; k < 2; ++k, ++to) {
        const double weight =
            1.0 / std::sqrt(alike ? 1.0 / (n.size * n.size) : a * row.alpha[k] + b * row.beta[k]);
        out.residual[to] = weight * residual(row, k, s, normalised.translation);
        out.jacobian.row(to) = weight * residual_jacobian<kParameters>(row, k, s).transpose() * from_original;
        out.shift.row(to) = (weight * row.h / n.size) * row.normal[k].transpose();
        out.row.push_back(sightings[i][0]);
      }
  }
  return out;
}

}  // namespace

WhiteResiduals white_residuals(const Table& table, const bool* chosen, const Transform& at,
                               const Options& options) {
  return options.model == Model::kSimilarity ? whiten<7>(table, chosen, at, options)
                                             : whiten<8>(table, chosen, at, options);
}

}  // namespace sonocal
