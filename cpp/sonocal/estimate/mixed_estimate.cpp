#include "sonocal/estimate/mixed_estimate.hpp"

#include <cmath>
#include <limits>

#include "sonocal/estimate/small_samples.hpp"
#include "sonocal/estimate/white_residuals.hpp"
#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"

namespace sonocal {
namespace {

// Which sightings agree changes little after the first.
constexpr int kRounds = 4;
// Of the greatest pivot, in coordinates of order one: below it a motion is free.
constexpr double kLeastPivot = 1e-12;

std::vector<int> within(const MixedRows& rows, const Transform& at, double limit) {
  std::vector<int> chosen;
  for (int c = 0; c < rows.size(); ++c)
    if (rows.square(at, c) <= limit) chosen.push_back(c);
  return chosen;
}

// The covariance at a fit, with the errors of those levels that were estimated. Normalised tangent.
template <int kParameters>
WiderCovariance covariance_as(const MixedNoise& noise, const LikelihoodFit& fit, NoiseLevels known) {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  const Variances levels = variances(noise.normalisation(), fit.levels);
  const Matrix3d linear = fit.transform.linear();
  std::vector<TangentRow<kParameters>> jacobian;
  std::vector<Vector2d> by_level;
  double px = 0, mm = 0;          // parts of all variances' sum
  Matrix alike = Matrix::Zero();  // information if all rows weighed alike, which motions are judged by
  MixedBlocks blocks(noise, fit.transform, levels);
  IndependentBlock block;
  while (blocks.next(block))
    for (int i = 0; i < block.count; ++i)
      for (int k = 0; k < 2; ++k) {
        const double weight = block.weight[k][i];
        if (!(weight > 0)) continue;
        const Vector3d normal(block.normal[k][0][i], block.normal[k][1][i], block.normal[k][2][i]);
        const Vector3d x(block.x[0][i], block.x[1][i], block.x[2][i]);
        jacobian.push_back(std::sqrt(weight) * residual_jacobian<kParameters>(normal, x, block.h[i], linear));
        const Eigen::Matrix<double, kParameters, 1> row =
            jacobian.back().transpose().template head<kParameters>();
        alike += row * row.transpose() / weight;
        px += levels.px * block.alpha[k][i];
        mm += levels.mm * block.beta[k][i];
        by_level.emplace_back(known.px > 0 ? 0.0 : levels.px * block.alpha[k][i] * weight,
                              known.mm > 0 ? 0.0 : levels.mm * block.beta[k][i] * weight);
      }
  const Eigen::Index count = static_cast<Eigen::Index>(jacobian.size());
  WhiteJacobian white(count, kParameters);
  Eigen::MatrixX2d unknown(count, 2);
  for (Eigen::Index m = 0; m < count; ++m) {
    white.row(m) = jacobian[m].template head<kParameters>();
    unknown.row(m) = by_level[m].transpose();
  }
  const Ldlt<kParameters> hold(alike);
  if (!(hold.least_pivot() > kLeastPivot * hold.greatest_pivot()))
    return {TangentMatrix::Constant(kParameters, kParameters, std::numeric_limits<double>::quiet_NaN()), 0,
            0};
  const Ldlt<kParameters> information(Matrix(fit.information));
  return small_sample_covariance(white, unknown, information.solve(Matrix(Matrix::Identity())),
                                 std::log(px / mm));
}

template <int kParameters>
TangentMatrix to_original(const TangentMatrix& normalised, const Transform& original,
                          const Normalisation& n) {
  const auto map = tangent_to_original<kParameters>(original, n);
  const Eigen::Matrix<double, kParameters, kParameters> matrix = normalised, turned = map.transpose();
  return product(map, product(matrix, turned));
}

// Original units.
WiderCovariance covariance_of(const MixedNoise& noise, const LikelihoodFit& fit, Model model,
                              NoiseLevels known) {
  const Normalisation& n = noise.normalisation();
  const Transform original = n.to_original(fit.transform);
  WiderCovariance found;
  switch (model) {
    case Model::kScaleKnown:
      found = covariance_as<6>(noise, fit, known);
      found.covariance = to_original<6>(found.covariance, original, n);
      break;
    case Model::kSimilarity:
      found = covariance_as<7>(noise, fit, known);
      found.covariance = to_original<7>(found.covariance, original, n);
      break;
    case Model::kAnisotropic:
      found = covariance_as<8>(noise, fit, known);
      found.covariance = to_original<8>(found.covariance, original, n);
      break;
    default:
      found = covariance_as<9>(noise, fit, known);
      found.covariance = to_original<9>(found.covariance, original, n);
  }
  return found;
}

}  // namespace

MixedEstimate maximise_mixed(const MixedTable& table, const Transform& start, Model model, NoiseLevels known,
                             double limit_mm) {
  const MixedRows rows(table);
  const Normalisation& n = rows.normalisation();
  const double limit = std::pow(limit_mm / n.size, 2);
  Transform at = n.to_normalised(start);
  MixedEstimate result;
  std::vector<int> chosen = within(rows, at, limit);
  for (int round = 0; round < kRounds && !chosen.empty(); ++round) {
    const MixedNoise noise(rows, chosen);
    const LikelihoodFit fit = maximise_likelihood(noise, at, model, known);
    at = fit.transform;
    result.inliers = noise.sightings();
    result.converged = fit.converged;
    result.levels = fit.levels;
    const WiderCovariance covariance = covariance_of(noise, fit, model, known);
    result.covariance = covariance.covariance;
    result.freedom = covariance.freedom;
    std::vector<int> now = within(rows, at, limit);
    if (now == chosen) break;
    chosen = std::move(now);
  }
  result.transform = n.to_original(at);
  for (int c = 0; c < rows.size(); ++c) result.squares.push_back(rows.square(at, c) * n.size * n.size);
  return result;
}

NormalEquations mixed_cost(const MixedRows& rows, const bool* chosen, const Transform& at,
                           NoiseLevels levels) {
  std::vector<int> sightings;
  for (int c = 0; c < rows.size(); ++c)
    if (chosen[c]) sightings.push_back(c);
  return weighted_cost(MixedNoise(rows, sightings), at, levels);
}

}  // namespace sonocal
