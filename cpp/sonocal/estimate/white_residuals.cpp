#include "sonocal/estimate/white_residuals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <type_traits>

#include "sonocal/estimate/mixed_noise.hpp"
#include "sonocal/estimate/white_rows.hpp"
#include "sonocal/linalg/ldlt.hpp"

namespace sonocal {

namespace {

// The i-th row of a block as seen along its k-th normal.
WhiteRow row_of(const IndependentBlock& block, int i, int k) {
  const auto vector = [i](const double (*axes)[Block::kRows]) {
    return Vector3d(axes[0][i], axes[1][i], axes[2][i]);
  };
  return {vector(block.normal[k]), vector(block.x),   block.h[i],       block.residual[k][i],
          block.weight[k][i],      block.alpha[k][i], block.beta[k][i], block.first_row[i]};
}

// Half of a needle's length makes of its ends' noise what one reach does: (1 + tau^2) / 2.
Reaches reaches_of(const PointLines& rows, int row) {
  const double length = std::sqrt(2.0) * rows.half_length(row);
  Reaches out;
  out.count = 1;
  out.reach[0] = rows.direction(row) / length;
  out.middle[0] = rows.middle(row) / length;
  return out;
}

template <int kParameters>
WhiteResiduals whiten(const Table& table, const bool* chosen, const Transform& at, const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Normalisation& n = rows.normalisation();
  const bool alike = options.weighting == Weighting::kGeometric;
  PointLines::Column selector(table.rows);
  for (int i = 0; i < table.rows; ++i) selector[i] = chosen[i] ? 0.0 : 1.0;
  const NoiseModel noise(rows, sightings_of(table), table.noise, selector, 0.5,
                         alike ? NoiseModel::Kind::kAlike : NoiseModel::Kind::kPhysical);
  const Variances levels = alike ? Variances{0, 1 / (n.size * n.size)} : variances(n, options.levels);
  const int count = 2 * static_cast<int>((selector < 0.5).count());
  WhiteRows<kParameters> out(count, at, n, table.dimension, alike);
  NoiseBlocks blocks(noise, out.at(), levels);
  IndependentBlock block;
  while (blocks.next(block))
    for (int i = 0; i < block.count; ++i) {
      const int row = block.first_row[i];
      const Reaches reaches = reaches_of(rows, row);
      const double fp = table.dimension == 2 && table.noise.px ? table.noise.px[row] : 1;
      const double fm = table.noise.mm ? table.noise.mm[row] : 1;
      for (int k = 0; k < PointLines::kPlanes; ++k)
        out.put(row_of(block, i, k), reaches, levels.px * fp * fp, levels.mm * fm * fm);
    }
  return out.finished();
}

// Of sightings of whatever: every point of a sighting by itself where all distances count alike.
template <int kParameters>
void put_alike(const MixedRows& rows, int sighting, double weight, WhiteRows<kParameters>& out) {
  const Target& target = rows.target(sighting);
  for (int i = rows.first(sighting); i < rows.first(sighting + 1); ++i) {
    const Vector3d away = out.at().apply(rows.point(i)) - target.middle;
    for (int k = 0; k < target.normals; ++k)
      out.put({target.normal[k], rows.point(i), 1, target.normal[k].dot(away), weight, 0, 0, i}, {}, 0, 0);
  }
}

Reaches reaches_of(const Target& target) {
  Reaches out;
  out.count = target.reaches;
  for (int k = 0; k < target.reaches; ++k) {
    out.reach[k] = target.reach[k];
    out.middle[k] = target.reach[k].dot(target.middle);
  }
  return out;
}

template <int kParameters>
WhiteResiduals whiten(const MixedTable& table, const bool* chosen, const Transform& at,
                      const Options& options) {
  const MixedRows rows(table);
  const Normalisation& n = rows.normalisation();
  std::vector<int> sightings, of_point(table.first[table.count]);
  int count = 0;
  for (int c = 0; c < rows.size(); ++c) {
    std::fill(of_point.begin() + rows.first(c), of_point.begin() + rows.first(c + 1), c);
    if (!chosen[c]) continue;
    sightings.push_back(c);
    count += rows.points(c) * rows.target(c).normals;
  }
  const bool alike = options.weighting == Weighting::kGeometric;
  WhiteRows<kParameters> out(count, at, n, table.dimension, alike);
  if (alike) {
    for (const int c : sightings) put_alike(rows, c, n.size * n.size, out);
    return out.finished();
  }
  const Variances levels = variances(n, options.levels);
  const MixedNoise noise(rows, sightings);
  MixedBlocks blocks(noise, out.at(), levels);
  IndependentBlock block;
  while (blocks.next(block))
    for (int i = 0; i < block.count; ++i) {
      const int c = of_point[block.first_row[i]];
      const Reaches reaches = reaches_of(rows.target(c));
      const double fm = rows.mm_factor(c);
      for (int k = 0; k < 2; ++k)
        if (block.weight[k][i] > 0) out.put(row_of(block, i, k), reaches, levels.px, levels.mm * fm * fm);
    }
  return out.finished();
}

// With columns of one length, in whose units rounding is alike.
template <int kParameters>
TangentMatrix inverse_as(const WhiteJacobian& jacobian) {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  constexpr double kLeastPivot = 1e-14;
  Matrix sum = Matrix::Zero();
  for (Eigen::Index m = 0; m < jacobian.rows(); ++m)
    for (int c = 0; c < kParameters; ++c)
      for (int r = c; r < kParameters; ++r) sum(r, c) += jacobian(m, r) * jacobian(m, c);
  double size[kParameters];
  for (int k = 0; k < kParameters; ++k) size[k] = std::sqrt(sum(k, k));
  for (int c = 0; c < kParameters; ++c)
    for (int r = c; r < kParameters; ++r) sum(r, c) /= size[r] * size[c];
  const Ldlt<kParameters> factor(sum);
  if (!(factor.least_pivot() > kLeastPivot))
    return TangentMatrix::Constant(kParameters, kParameters, std::numeric_limits<double>::quiet_NaN());
  Matrix inverse = factor.solve(Matrix(Matrix::Identity()));
  for (int c = 0; c < kParameters; ++c)
    for (int r = 0; r < kParameters; ++r) inverse(r, c) /= size[r] * size[c];
  return inverse;
}

// f of the number of a model's parameters, known when this is compiled.
template <class Function>
auto by_parameters(Eigen::Index parameters, const Function& f) {
  switch (parameters) {
    case 6:
      return f(std::integral_constant<int, 6>());
    case 7:
      return f(std::integral_constant<int, 7>());
    case 8:
      return f(std::integral_constant<int, 8>());
    default:
      return f(std::integral_constant<int, 9>());
  }
}

}  // namespace

WhiteResiduals white_residuals(const Table& table, const bool* chosen, const Transform& at,
                               const Options& options) {
  return by_parameters(parameter_count(options.model), [&](auto parameters) {
    return whiten<decltype(parameters)::value>(table, chosen, at, options);
  });
}

WhiteResiduals white_residuals(const MixedTable& table, const bool* chosen, const Transform& at,
                               const Options& options) {
  return by_parameters(parameter_count(options.model), [&](auto parameters) {
    return whiten<decltype(parameters)::value>(table, chosen, at, options);
  });
}

TangentMatrix inverse_information(const WhiteJacobian& jacobian) {
  return by_parameters(jacobian.cols(),
                       [&](auto parameters) { return inverse_as<decltype(parameters)::value>(jacobian); });
}

}  // namespace sonocal
