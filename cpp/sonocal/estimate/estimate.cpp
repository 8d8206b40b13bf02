#include "sonocal/estimate/estimate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "sonocal/estimate/likelihood.hpp"
#include "sonocal/estimate/start.hpp"
#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

using Column = PointLines::Column;

constexpr int kLikelihoodRounds = 4;
constexpr double kFewOfMany = 1e-4;

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
  result.least_information = symmetric_eigenvalues(geometric)[0] / std::max(result.inliers, 1);
  result.transform = n.to_original(normalised);
  rows.squared_distances(normalised, result.squares);
  result.squares *= n.size * n.size;
  result.squared_sum = (squares <= limit).select(result.squares, 0.0).sum();
  result.covariance =
      TangentMatrix::Constant(kParameters, kParameters, std::numeric_limits<double>::quiet_NaN());
  result.found = true;
  if (!(result.least_information > 0)) return;
  const Matrix information =
      likelihood ? Matrix(likelihood->information) : Matrix(geometric * (n.size * n.size));
  const Matrix map = tangent_to_original<kParameters>(result.transform, n);
  result.covariance = product(map, Ldlt<kParameters>(information).solve(Matrix(map.transpose())));
  if (likelihood) result.levels = likelihood->levels;
}

void report(const PointLines& rows, const Transform& normalised, const Column& squares, double limit,
            const std::optional<LikelihoodFit>& likelihood, Model model, Estimate& result) {
  switch (model) {
    case Model::kScaleKnown:
      return report_as<6>(rows, normalised, squares, limit, likelihood, result);
    case Model::kSimilarity:
      return report_as<7>(rows, normalised, squares, limit, likelihood, result);
    case Model::kAnisotropic:
      return report_as<8>(rows, normalised, squares, limit, likelihood, result);
    default:
      return report_as<9>(rows, normalised, squares, limit, likelihood, result);
  }
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
  if (options.model == Model::kScaleKnown) result.transform.scales.setConstant(options.scale);  // to the bit
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
  const Normalisation& n = rows.normalisation();
  Transform refined =
      n.to_normalised(start);  // about the points' centre, which another scale leaves in its place
  if (options.model == Model::kScaleKnown) refined.scales.setConstant(options.scale * n.image_size / n.size);
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
  if (options.model == Model::kScaleKnown) result.transform.scales.setConstant(options.scale);
  return result;
}

}  // namespace sonocal
