#include "sonocal/estimate/white_residuals.hpp"

#include <cmath>

#include "sonocal/linalg/product.hpp"

namespace sonocal {

namespace {

// sum += by v v'
template <int kSize>
void add_outer(Eigen::Matrix<double, kSize, kSize>& sum, double by,
               const Eigen::Matrix<double, 1, kSize>& v) {
  for (int c = 0; c < kSize; ++c) {
    const double of_column = by * v[c];
    for (int r = 0; r < kSize; ++r) sum.data()[r + kSize * c] += of_column * v[r];
  }
}

// Where a segment's middle is along its direction, and half its length.
struct Needle {
  double middle, half_length;
};

// Sums over residuals r = n . (S x + h t) + h o with variance v = A + B, A of pixels and B of the segment's
// ends.
//
// A pixel's noise e adds n . dS e to the derivative J of r, the direction's noise q = -(n . q) d . d(S x + h
// t): both are in J'J, and in J'r, too, where the derivatives of A and B take them out as long as the levels
// are right.
template <int kParameters>
struct NoiseInJacobian {
  using Row = TangentRow<kParameters>;
  using Square = Eigen::Matrix<double, Row::SizeAtCompileTime, Row::SizeAtCompileTime>;
  Square px = Square::Zero(), mm = Square::Zero();
  Row by_ratio = Row::Zero();

  // a, b: the squared levels of the row's point and segment.
  void add(const Vector3d& n, const Vector3d& d, const Vector3d& x, double h, const Needle& needle,
           const Transform& at, const Matrix3d& s, int dimension, double weight, double a, double b) {
    const double tau = (d.dot(s * x + h * at.translation) - h * needle.middle) / needle.half_length;
    const Row along = residual_jacobian<kParameters>(d, x, h, s);
    Row by_px = Row::Zero();  // half the derivative of A
    double of_px = 0;
    for (int axis = 0; axis < dimension; ++axis) {
      const Row of_axis = residual_jacobian<kParameters>(n, Vector3d::Unit(axis), 0, s);
      const double seen = n.dot(s.col(axis));
      add_outer(px, weight * a, of_axis);
      by_px += (a * seen) * of_axis;
      of_px += a * seen * seen;
    }
    const double length = needle.half_length, of_mm = 1 / weight - of_px;
    add_outer(mm, weight * 0.5 * b / (length * length), along);
    by_ratio += (weight * weight) * ((of_px * 0.5 * b * tau / length) * along - of_mm * by_px);
  }
};

template <int kParameters>
WhiteResiduals whiten(const Table& table, const bool* chosen, const Transform& at, const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  const Normalisation& n = rows.normalisation();
  const Transform normalised = n.to_normalised(at);
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  const Matrix from_original = tangent_to_normalised<kParameters>(at, n);
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
  const Matrix3d linear = normalised.linear();
  NoiseInJacobian<kParameters> in_jacobian;
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
        const auto jacobian = residual_jacobian<kParameters>(normal, x, block.h[i], linear);
        for (int c = 0; c < kParameters; ++c) {
          double sum = 0;
          for (int j = 0; j < kParameters; ++j) sum += jacobian[j] * from_original(j, c);
          out.jacobian(to, c) = root * sum;
        }
        out.shift.row(to) = (root * block.h[i] / n.size) * normal.transpose();
        const int row = block.first_row[i];
        out.row.push_back(row);
        if (alike) continue;
        const double fp = table.dimension == 2 && table.noise.px ? table.noise.px[row] : 1;
        const double fm = table.noise.mm ? table.noise.mm[row] : 1;
        in_jacobian.add(normal, rows.direction(row), x, block.h[i], {rows.middle(row), rows.half_length(row)},
                        normalised, linear, table.dimension, weight, levels.px * fp * fp,
                        levels.mm * fm * fm);
      }
  const auto original = [&](const auto& sums) -> TangentMatrix {
    const Matrix used = sums.template topLeftCorner<kParameters, kParameters>();
    return transposed_product(from_original, product(used, from_original));
  };
  out.from_noise[0] = original(in_jacobian.px);
  out.from_noise[1] = original(in_jacobian.mm);
  const Eigen::Matrix<double, kParameters, 1> by_ratio =
      in_jacobian.by_ratio.transpose().template head<kParameters>();
  out.by_ratio = transposed_product(from_original, by_ratio);
  return out;
}

}  // namespace

WhiteResiduals white_residuals(const Table& table, const bool* chosen, const Transform& at,
                               const Options& options) {
  switch (options.model) {
    case Model::kScaleKnown:
      return whiten<6>(table, chosen, at, options);
    case Model::kSimilarity:
      return whiten<7>(table, chosen, at, options);
    case Model::kAnisotropic:
      return whiten<8>(table, chosen, at, options);
    default:
      return whiten<9>(table, chosen, at, options);
  }
}

}  // namespace sonocal
