#include "sonocal/estimate/start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "sonocal/estimate/certificate.hpp"
#include "sonocal/estimate/refine.hpp"
#include "sonocal/linalg/sort_by.hpp"

namespace sonocal {
namespace {

using Column = PointLines::Column;
using Agreeing = Eigen::Array<bool, Eigen::Dynamic, 1>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kLocalRounds = 2;
constexpr int kLocalIterations = 2;
constexpr int kSettlingRounds = 4;
constexpr int kFinalRounds = 20;
constexpr double kLittle = 1e-2;  // part of a score
// Of a few rows' samples, the best are refined in search of other answers; nearer than this is the same one.
constexpr int kMostStarts = 12;
constexpr double kSameRotation = 1e-3;
// A consensus is as clear among this many rows as among a million.
constexpr int kMostConsensusRows = 4000;
constexpr int kAutoSamples = 300;
// Squared distances of sound rows are sigma^2 times a chi-squared variable of two degrees of freedom.
constexpr double kChi2Median = 1.386, kChi2Most = 10.6;  // 50 %, 99.5 %

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
  double clean_share(const Transform& a) {
    rows_.squared_distances(a, squares_);
    return std::pow(static_cast<double>((squares_ <= limit_).count()) / rows_.size(), sample_size());
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

// Median squared distance over random samples' best transform, of the rows that are not in its sample: the
// noise, while most of them are sound.
template <class Sampler>
double limit_from_noise(const PointLines& rows, Sampler& sampler, std::uint64_t seed) {
  Random random(seed);
  Sample sample;
  Candidates candidates;
  Column squares;
  double least = kInfinity;
  if (sampler.units() < sampler.sample_size()) return least;
  const int fitted = rows.size() / sampler.units() * sampler.sample_size();
  if (rows.size() <= fitted) return least;
  for (int i = 0; i < kAutoSamples; ++i) {
    sampler.draw(random, sample);
    const int count = sampler.solve(sample, random, candidates);
    for (int k = 0; k < count; ++k) {
      rows.squared_distances(candidates[k], squares);
      // The median is less where more than half of all are: of most candidates that is all one has to know.
      const Eigen::Index half = fitted + (squares.size() - fitted) / 2;
      if ((squares < least).count() <= half) continue;
      std::nth_element(squares.data(), squares.data() + half, squares.data() + squares.size());
      least = squares[half];
    }
  }
  return least * kChi2Most / kChi2Median;
}

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
  sort_by(starts, [](const auto& one) { return one.first; });
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
    // Beside its own start, not the answer, which may itself have shrunk to nothing.
    if (refined.converged && !known && !ran_away(refined.transform, start))
      found.push_back(refined.transform);
  }
  found.erase(found.begin());
  return found;
}

// The best of what few rows are fitted by, where the answer is not shown to be: refinement ends at the
// nearest. All others came to rest.
template <class Sampler>
void take_best_of_few(const PointLines& rows, Sampler& sampler, sonocal::Model model, Start& answer) {
  Column squares;
  rows.squared_distances(answer.transform, squares);
  const NormalEquations cost = rows.geometric_cost(squares, answer.limit);
  if (certificate(cost, answer.transform, model) == Certificate::kOptimal) return;
  const auto others = other_answers(rows, sampler, answer.transform, answer.limit, model);
  for (const Transform& other : others) {
    if (!(cost.cost(other) < cost.cost(answer.transform))) continue;
    answer.transform = other;
    answer.converged = true;
  }
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
  const bool few = sampler.enumerable() && combinations(sampler.units(), sampler.sample_size()) <=
                                               options.consensus.exhaustive_samples;
  if (few && options.weighting == Weighting::kLikelihood)
    start.others = other_answers(rows, sampler, start.transform, start.limit, options.model);
  else if (few)
    take_best_of_few(rows, sampler, options.model, start);
  return start;
}

Start consensus_of(const PointLines& rows, const Sightings& sightings, const Labels& labels,
                   const Options& options) {
  const Normalisation& n = rows.normalisation();
  const double scale = options.model == Model::kScaleKnown ? options.scale * n.image_size / n.size : 0;
  if (rows.dimension() == 2) return consensus_with(rows, ImageRows(rows, labels, scale), options);
  const TwoSightings sampler(rows, sightings);
  return scale > 0 ? consensus_with(rows, AtScale(sampler, scale), options)
                   : consensus_with(rows, sampler, options);
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

}  // namespace

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

}  // namespace sonocal
