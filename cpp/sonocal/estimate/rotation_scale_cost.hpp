// The cost of point-to-line registration by rotation and scale alone.
#pragma once

#include "sonocal/estimate/normal_equations.hpp"
#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {

// Of the translation's greatest information: a direction with less is free.
constexpr double kFree = 1e-13;

// h^-1 b for a symmetric positive h, the pseudo-inverse where a direction is free.
template <int kCount>
Eigen::Matrix<double, 3, kCount> solve_symmetric(const Matrix3d& h,
                                                 const Eigen::Matrix<double, 3, kCount>& b) {
  const Ldlt<3> factors(h);
  if (factors.least_pivot() > kFree * factors.greatest_pivot()) return factors.solve(b);
  const SymmetricEigen eigen = symmetric_eigen(h);
  Matrix3d inverse = Matrix3d::Zero();
  for (int i = 0; i < 3; ++i) {
    const Vector3d v = eigen.vectors.col(i);
    if (eigen.values[i] > kFree * eigen.values[2]) inverse += v * v.transpose() / eigen.values[i];
  }
  return product(inverse, b);
}

// The cost at the best translation for every rotation and scale: residuals are linear in the translation, so
// it follows from the columns s of R diag(scales) in closed form,
//
//     t(s) = t0 - H_tt^-1 (g_t + H_tt t0 + H_ts s),
//
// and only rotation and scale are left to search (variable projection, Golub and Pereyra 1973). Along a
// direction that no row sees the translation stays what it was, t0.
template <int kColumns>
class RotationScaleCost {
 public:
  static constexpr int kSize = 3 * kColumns;
  using Vector = Columns<kColumns>;
  using Square = Eigen::Matrix<double, kSize, kSize>;

  RotationScaleCost(const NormalEquations& all, const Vector3d& t0) {
    const Matrix3d h_tt = all.h().template bottomRightCorner<3, 3>();
    const Eigen::Matrix<double, 3, kSize> h_ts = all.h().template block<3, kSize>(9, 0);
    const Vector3d g_t = all.g().template tail<3>();
    by_columns_ = solve_symmetric<kSize>(h_tt, h_ts);
    constant_ = t0 - solve_symmetric<1>(h_tt, g_t + product(h_tt, t0));
    h_ = all.h().template topLeftCorner<kSize, kSize>();
    h_ -= transposed_product(h_ts, by_columns_);
    g_ = all.g().template head<kSize>() + transposed_product(h_ts, constant_);
    c_ = all.c() + g_t.dot(constant_);
  }

  double at(const Vector& s) const { return s.dot(product(h_, s) + 2.0 * g_) + c_; }
  // Half the cost's derivatives by the columns.
  Vector gradient(const Vector& s) const { return product(h_, s) + g_; }
  const Square& curvature() const { return h_; }

  // J'J, J'r and half the cost's second derivatives by (turn, log scales).
  template <int kScales>
  void linearise(const Vector& s, Eigen::Matrix<double, 3 + kScales, 3 + kScales>& jtj,
                 Eigen::Matrix<double, 3 + kScales, 1>& jtr,
                 Eigen::Matrix<double, 3 + kScales, 3 + kScales>& newton) const {
    const auto d = columns_jacobian<kColumns, kScales>(s);
    const Vector slope = gradient(s);
    jtj = transposed_product(d, product(h_, d));
    jtr = transposed_product(d, slope);
    newton = jtj;
    for (int column = 0; column < kColumns; ++column) {
      const Vector3d c = s.template segment<3>(3 * column), g = slope.template segment<3>(3 * column);
      const double along = g.dot(c);
      for (int i = 0; i < 3; ++i) {
        newton(i, i) -= along;
        for (int j = 0; j < 3; ++j) newton(i, j) += 0.5 * (g[i] * c[j] + c[i] * g[j]);
      }
      if (kScales != 1 && column >= kScales) continue;
      const int growth = kScales == 1 ? 3 : 3 + column;
      const Vector3d turned = cross(c, g);
      for (int i = 0; i < 3; ++i) {
        newton(i, growth) += turned[i];
        newton(growth, i) += turned[i];
      }
      newton(growth, growth) += along;
    }
  }

  Vector3d translation(const Vector& s) const { return constant_ - product(by_columns_, s); }

 private:
  Square h_;
  Vector g_;
  double c_;
  Eigen::Matrix<double, 3, kSize> by_columns_;
  Vector3d constant_;
};

}  // namespace sonocal
