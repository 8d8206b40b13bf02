// Independent residuals put row by row into what a statistical model on top takes.
#pragma once

#include <cmath>

#include "sonocal/estimate/white_residuals.hpp"
#include "sonocal/linalg/product.hpp"

namespace sonocal {

// How the noise of what spans a target grows along it: noise at a place y is that at its middle and, for each
// reach, reach . y - middle times another of its size.
struct Reaches {
  int count = 0;
  Vector3d reach[2];
  double middle[2];
};

// A residual n . (S x + h t) + h o of the variance 1 / weight, which is px alpha + mm beta of the levels.
struct WhiteRow {
  Vector3d normal, x;
  double h, residual, weight, alpha, beta;
  int table_row;
};

// Sums over residuals with variance v = A + B, A of pixels and B of what spans the targets.
//
// A pixel's noise e adds n . dS e to the derivative J of r, the target's own q_k = -(n . q_k) reach_k . d(S x
// + h t): both are in J'J, and in J'r, too, where the derivatives of A and B take them out as long as the
// levels are right.
template <int kParameters>
class NoiseInJacobian {
 public:
  using Row = TangentRow<kParameters>;
  static constexpr int kMost = Row::SizeAtCompileTime;
  using Square = Eigen::Matrix<double, kMost, kMost>;

  Square px = Square::Zero(), mm = Square::Zero();
  Row by_ratio = Row::Zero();

  // a, b: the squared levels of the row's point and target.
  void add(const WhiteRow& row, const Reaches& reaches, const Transform& at, const Matrix3d& s, int dimension,
           double a, double b) {
    Row by_px = Row::Zero(), by_mm = Row::Zero();  // half the derivatives of A and B
    double of_px = 0;
    for (int axis = 0; axis < dimension; ++axis) {
      const Row of_axis = residual_jacobian<kParameters>(row.normal, Vector3d::Unit(axis), 0, s);
      const double seen = row.normal.dot(s.col(axis));
      add_outer(px, row.weight * a, of_axis);
      by_px += (a * seen) * of_axis;
      of_px += a * seen * seen;
    }
    const Vector3d place = s * row.x + row.h * at.translation;
    for (int k = 0; k < reaches.count; ++k) {
      const Row along = residual_jacobian<kParameters>(reaches.reach[k], row.x, row.h, s);
      add_outer(mm, row.weight * b, along);
      by_mm += (b * (reaches.reach[k].dot(place) - row.h * reaches.middle[k])) * along;
    }
    by_ratio += (row.weight * row.weight) * (of_px * by_mm - (1 / row.weight - of_px) * by_px);
  }

 private:
  static void add_outer(Square& sum, double by, const Row& v) {
    for (int c = 0; c < kMost; ++c) {
      const double of_column = by * v[c];
      for (int r = 0; r < kMost; ++r) sum.data()[r + kMost * c] += of_column * v[r];
    }
  }
};

// Rows in normalised coordinates, taken to original ones.
template <int kParameters>
class WhiteRows {
 public:
  // At most so many rows come.
  WhiteRows(int rows, const Transform& at, const Normalisation& n, int dimension, bool alike)
      : normalised_(n.to_normalised(at)),
        linear_(normalised_.linear()),
        from_original_(tangent_to_normalised<kParameters>(at, n)),
        size_(n.size),
        px_(1 / (n.image_size * n.image_size)),
        mm_(1 / (n.size * n.size)),
        dimension_(dimension),
        alike_(alike) {
    out_.jacobian.resize(rows, kParameters);
    out_.shift.resize(rows, 3);
    out_.residual.resize(rows);
    out_.by_level.setZero(rows, 2);
    out_.row.reserve(rows);
  }

  const Transform& at() const { return normalised_; }

  // a, b: the squared levels of the row's point and target, normalised.
  void put(const WhiteRow& row, const Reaches& reaches, double a, double b) {
    const auto to = static_cast<Eigen::Index>(out_.row.size());
    const double root = std::sqrt(row.weight);
    if (!alike_) {
      const Vector2d by_levels(row.alpha * px_, row.beta * mm_);
      out_.by_level.row(to) = row.weight * by_levels.transpose();
      out_.by_levels += by_levels;
    }
    out_.residual[to] = root * row.residual;
    const auto jacobian = residual_jacobian<kParameters>(row.normal, row.x, row.h, linear_);
    for (int c = 0; c < kParameters; ++c) {
      double sum = 0;
      for (int j = 0; j < kParameters; ++j) sum += jacobian[j] * from_original_(j, c);
      out_.jacobian(to, c) = root * sum;
    }
    out_.shift.row(to) = (root * row.h / size_) * row.normal.transpose();
    out_.row.push_back(row.table_row);
    if (!alike_) in_jacobian_.add(row, reaches, normalised_, linear_, dimension_, a, b);
  }

  WhiteResiduals finished() {
    const auto rows = static_cast<Eigen::Index>(out_.row.size());
    if (rows < out_.residual.size()) {
      out_.jacobian.conservativeResize(rows, kParameters);
      out_.shift.conservativeResize(rows, 3);
      out_.residual.conservativeResize(rows);
      out_.by_level.conservativeResize(rows, 2);
    }
    out_.from_noise[0] = original(in_jacobian_.px);
    out_.from_noise[1] = original(in_jacobian_.mm);
    const Eigen::Matrix<double, kParameters, 1> by_ratio =
        in_jacobian_.by_ratio.transpose().template head<kParameters>();
    out_.by_ratio = transposed_product(from_original_, by_ratio);
    return std::move(out_);
  }

 private:
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;

  TangentMatrix original(const typename NoiseInJacobian<kParameters>::Square& sums) const {
    const Matrix used = sums.template topLeftCorner<kParameters, kParameters>();
    return transposed_product(from_original_, product(used, from_original_));
  }

  const Transform normalised_;
  const Matrix3d linear_;
  const Matrix from_original_;
  const double size_, px_, mm_;
  const int dimension_;
  const bool alike_;
  WhiteResiduals out_;
  NoiseInJacobian<kParameters> in_jacobian_;
};

}  // namespace sonocal
