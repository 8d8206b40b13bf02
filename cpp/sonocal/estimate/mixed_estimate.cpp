#include "sonocal/estimate/mixed_estimate.hpp"

#include <cmath>
#include <limits>

#include "sonocal/linalg/product.hpp"

namespace sonocal {
namespace {

// Which sightings agree changes little after the first.
constexpr int kRounds = 4;

std::vector<int> within(const MixedRows& rows, const Transform& at, double limit) {
  std::vector<int> chosen;
  for (int c = 0; c < rows.size(); ++c)
    if (rows.square(at, c) <= limit) chosen.push_back(c);
  return chosen;
}

template <int kParameters>
TangentMatrix to_original(const TangentMatrix& normalised, const Transform& original,
                          const Normalisation& n) {
  const auto map = tangent_to_original<kParameters>(original, n);
  const Eigen::Matrix<double, kParameters, kParameters> matrix = normalised, turned = map.transpose();
  return product(map, product(matrix, turned));
}

// NaN where a motion is free.
TangentMatrix covariance_in(const LikelihoodCovariance& found, const Transform& original,
                            const Normalisation& n) {
  const Eigen::Index size = found.matrix.rows();
  if (!found.determined) return TangentMatrix::Constant(size, size, std::numeric_limits<double>::quiet_NaN());
  return size == 6   ? to_original<6>(found.matrix, original, n)
         : size == 7 ? to_original<7>(found.matrix, original, n)
                     : to_original<8>(found.matrix, original, n);
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
    const LikelihoodCovariance covariance = covariance_of(noise, fit, model, known);
    result.covariance = covariance_in(covariance, n.to_original(at), n);
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
