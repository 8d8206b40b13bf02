#include "sonocal/estimate/white_residuals.hpp"

#include <cmath>

namespace sonocal {
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
      tangent_to_normalised<kParameters>(at, n);
  const bool alike = options.weighting == Weighting::kGeometric;
  PointLines::Column selector(table.rows);
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
