#include "sonocal/estimate.hpp"

#include <Eigen/Cholesky>
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
constexpr int kLocalRounds = 2;
constexpr int kLocalIterations = 2;
constexpr int kSettlingRounds = 4;
constexpr int kFinalRounds = 20;
constexpr int kFinalIterations = 60;
constexpr double kLittle = 1e-2;  // part of a score
constexpr int kLikelihoodRounds = 4;
constexpr double kFewOfMany = 1e-4;
// Of a few rows' samples, the best are refined in search of other answers; nearer than this is the same one.
constexpr int kMostStarts = 12;
constexpr double kSameRotation = 1e-3;
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
    for (int round = 0, improved = 1; improved && round < kSettlingRounds; ++round) {
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
  std::vector<Transform> others;  // that fit the rows that agree, locally as well as can be
  double limit;
  int samples = 0;
  bool found = false;
  bool converged = false;
};

// What else the rows within the limit of an answer are fitted by: few rows leave several answers, of which
// the paper's cost need not have the likeliest for its least.
template <class Sampler>
std::vector<Transform> other_answers(const PointLines& rows, Sampler& sampler, const Transform& answer,
                                     double limit, sonocal::Model model) {
  std::vector<std::pair<double, Transform>> starts;
  Sample sample{0, 1, 2, 3, 4, 5, 6};
  Random random(0);
  Candidates candidates;
  do {
    const int count = sampler.solve(sample, random, candidates);
    for (int i = 0; i < count; ++i)
      starts.emplace_back(rows.truncated_sum(candidates[i], limit, kInfinity), candidates[i]);
  } while (next_combination(sample, sampler.sample_size(), sampler.units()));
  std::sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  if (starts.size() > kMostStarts) starts.resize(kMostStarts);

  Column squares;
  rows.squared_distances(answer, squares);
  const NormalEquations cost = rows.geometric_cost(squares, limit);
  std::vector<Transform> found{answer};
  for (const auto& [score, start] : starts) {
    const Refinement refined = refine(cost, start, model, kFinalIterations);
    const bool known = std::any_of(found.begin(), found.end(), [&](const Transform& other) {
      return (refined.transform.rotation - other.rotation).norm() < kSameRotation;
    });
    if (refined.converged && !known && !ran_away(refined.transform, answer))
      found.push_back(refined.transform);
  }
  found.erase(found.begin());
  return found;
}

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
  if (options.weighting == Weighting::kLikelihood && sampler.enumerable() &&
      combinations(sampler.units(), sampler.sample_size()) <= options.consensus.exhaustive_samples)
    start.others = other_answers(rows, sampler, start.transform, start.limit, options.model);
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
template <int kParameters>
Eigen::Matrix<double, kParameters, kParameters> tangent_to_original(const Transform& original,
                                                                    const Normalisation& normalisation) {
  const Matrix3d s = original.linear();
  const Vector3d centre = normalisation.image_centre;
  Eigen::Matrix<double, kParameters, kParameters> map;
  map.setIdentity();
  map.template block<3, 3>(3, 0) = cross_matrix(s * centre);
  map.template block<3, 3>(3, 3) *= normalisation.size;
  if (kParameters == 7)
    map.template block<3, 1>(3, 6) = -s * centre;
  else
    for (int axis = 0; axis < kParameters - 6; ++axis)
      map.template block<3, 1>(3, 6 + axis) = -s.col(axis) * centre[axis];
  return map;
}

// Fills in what follows from the normalised transform: the rows with squares <= limit are its inliers.
template <int kParameters>
void report_as(const PointLines& rows, const Transform& normalised, const Column& squares, double limit,
               const std::optional<LikelihoodFit>& likelihood, Estimate& result) {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  const Normalisation& n = rows.normalisation();
  const NormalEquations equations = rows.geometric_cost(squares, limit);
  Matrix geometric;
  Eigen::Matrix<double, kParameters, 1> unused;
  equations.linearise<kParameters>(normalised, geometric, unused);
  result.inliers = equations.rows();
  result.least_information =
      Eigen::SelfAdjointEigenSolver<Matrix>(geometric, Eigen::EigenvaluesOnly).eigenvalues()[0] /
      std::max(result.inliers, 1);
  result.transform = n.to_original(normalised);
  rows.squared_distances(normalised, result.squares);
  result.squares *= n.size * n.size;
  result.covariance =
      TangentMatrix::Constant(kParameters, kParameters, std::numeric_limits<double>::quiet_NaN());
  result.found = true;
  if (!(result.least_information > 0)) return;
  const Matrix information =
      likelihood ? Matrix(likelihood->information) : Matrix(geometric * (n.size * n.size));
  const Matrix map = tangent_to_original<kParameters>(result.transform, n);
  result.covariance = map * information.ldlt().solve(Matrix(map.transpose()));
  if (likelihood) result.levels = likelihood->levels;
}

void report(const PointLines& rows, const Transform& normalised, const Column& squares, double limit,
            const std::optional<LikelihoodFit>& likelihood, Model model, Estimate& result) {
  if (model == Model::kSimilarity)
    report_as<7>(rows, normalised, squares, limit, likelihood, result);
  else
    report_as<8>(rows, normalised, squares, limit, likelihood, result);
}

// Weighted refinement, and again where it changed which rows agree by more than a few of very many.
LikelihoodFit weigh(const PointLines& rows, const Sightings& sightings, const RowNoise& noise, Start& start,
                    const Options& options, Column& squares) {
  LikelihoodFit fit;
  int agreeing = -1;
  for (int round = 0; round < kLikelihoodRounds; ++round) {
    rows.squared_distances(start.transform, squares);
    const int now = static_cast<int>((squares <= start.limit).count());
    if (std::abs(now - agreeing) <= kFewOfMany * now) break;
    agreeing = now;
    fit = maximise_likelihood(NoiseModel(rows, sightings, noise, squares, start.limit), start.transform,
                              options.model, options.levels);
    start.transform = fit.transform;
  }
  rows.squared_distances(start.transform, squares);
  return fit;
}

// The likeliest of the answers that few rows leave, for the rows that agree with the first.
void choose_likeliest(const PointLines& rows, const Sightings& sightings, const RowNoise& noise, Start& start,
                      const Options& options, Column& squares, LikelihoodFit& fit) {
  if (start.others.empty()) return;
  const NoiseModel model(rows, sightings, noise, squares, start.limit);
  double least = deviance(model, fit.transform, fit.levels);
  const Transform first = fit.transform;
  for (const Transform& other : start.others) {
    const LikelihoodFit rival = maximise_likelihood(model, other, options.model, options.levels);
    const double value = deviance(model, rival.transform, rival.levels);
    if (!rival.converged || !(value < least)) continue;
    least = value;
    start.transform = rival.transform;
  }
  if (start.transform.rotation != first.rotation)
    fit = weigh(rows, sightings, noise, start, options, squares);
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
    choose_likeliest(rows, sightings, table.noise, start, options, squares, *fit);
    result.converged = fit->converged;
  }
  report(rows, start.transform, squares, start.limit, fit, options.model, result);
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
    fit = maximise_likelihood(NoiseModel(rows, sightings, table.noise, selector, kChosen), refined,
                              options.model, options.levels);
    refined = fit->transform;
    result.converged = fit->converged;
  }
  report(rows, refined, selector, kChosen, fit, options.model, result);
  return result;
}

namespace {

// Derivative of a residual n . (S x + h t) by the tangent.
template <int kParameters>
Eigen::Matrix<double, 1, kParameters> residual_jacobian(const Vector3d& n, const Vector3d& x, double h,
                                                        const Matrix3d& s) {
  Eigen::Matrix<double, 1, kParameters> j;
  const Vector3d sx = s * x;
  j.template head<3>() = sx.cross(n);
  j.template segment<3>(3) = h * n;
  if (kParameters == 7) {
    j[6] = n.dot(sx);
  } else {
    j[6] = n.dot(s.col(0)) * x[0];
    j[kParameters - 1] = n.dot(s.col(1)) * x[1];
  }
  return j;
}

template <int kParameters>
WhiteResiduals whiten(const Table& table, const bool* chosen, const Transform& at, const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Normalisation& n = rows.normalisation();
  const Transform normalised = n.to_normalised(at);
  const Eigen::Matrix<double, kParameters, kParameters> from_original =
      tangent_to_original<kParameters>(at, n).inverse();
  const bool alike = options.weighting == Weighting::kGeometric;
  Column selector(table.rows);
  for (int i = 0; i < table.rows; ++i) selector[i] = chosen[i] ? 0.0 : 1.0;
  const NoiseModel noise(rows, sightings_of(table), table.noise, selector, 0.5,
                         alike ? NoiseModel::Kind::kAlike : NoiseModel::Kind::kPhysical);
  const double px = 1 / (n.image_size * n.image_size), mm = 1 / (n.size * n.size);
  const Variances levels =
      alike ? Variances{0, mm}
            : Variances{px * std::pow(options.levels.px, 2), mm * std::pow(options.levels.mm, 2)};

  const int count = 2 * static_cast<int>((selector < 0.5).count());
  WhiteResiduals out;
  out.jacobian.resize(count, kParameters);
  out.shift.resize(count, 3);
  out.residual.resize(count);
  out.by_level.setZero(count, 2);
  out.row.reserve(count);
  NoiseBlocks blocks(noise, normalised, levels);
  IndependentBlock block;
  int to = 0;
  while (blocks.next(block))
    for (int i = 0; i < block.count; ++i)
      for (int k = 0; k < PointLines::kPlanes; ++k, ++to) {
        const double weight = block.weight[k][i], root = std::sqrt(weight);
        const Vector3d normal(block.normal[k][0][i], block.normal[k][1][i], block.normal[k][2][i]);
        const Vector3d x(block.x[0][i], block.x[1][i], block.x[2][i]);
        if (!alike) out.by_level.row(to) << block.alpha[k][i] * px * weight, block.beta[k][i] * mm * weight;
        out.residual[to] = root * block.residual[k][i];
        out.jacobian.row(to) =
            root * residual_jacobian<kParameters>(normal, x, block.h[i], normalised.linear()) * from_original;
        out.shift.row(to) = (root * block.h[i] / n.size) * normal.transpose();
        out.row.push_back(block.first_row[i]);
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
