// Residuals as a statistical model on top needs them.
#pragma once

#include <vector>

#include "sonocal/estimate/mixed_table.hpp"
#include "sonocal/estimate/small_samples.hpp"
#include "sonocal/estimate/table.hpp"

namespace sonocal {

// Derivative of a residual n . (S x + h t) by the tangent: 8 numbers, of which a model of fewer parameters
// leaves the last ones unused, or 9. 7 parameters are one growth of all columns.
template <int kParameters>
using TangentRow = Eigen::Matrix<double, 1, (kParameters > 8 ? kParameters : 8)>;
template <int kParameters>
TangentRow<kParameters> residual_jacobian(const Vector3d& n, const Vector3d& x, double h, const Matrix3d& s) {
  const Vector3d sx = s * x, turned = cross(sx, n);
  TangentRow<kParameters> j;
  for (int i = 0; i < 3; ++i) {
    j[i] = turned[i];
    j[3 + i] = h * n[i];
  }
  constexpr bool alike = kParameters <= 7;
  j[6] = alike ? n.dot(sx) : n.dot(s.col(0)) * x[0];
  j[7] = alike ? 0.0 : n.dot(s.col(1)) * x[1];
  if constexpr (kParameters > 8) j[8] = n.dot(s.col(2)) * x[2];
  return j;
}

// Residuals of the rows with chosen[i], made independent and of unit variance under the levels. Original
// units.
struct WhiteResiduals {
  WhiteJacobian jacobian;  // M x k
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>
      shift;  // M x 3: derivative by a shift of the line
  // M x 2: derivative of the log of what was each residual's variance by the levels' squares, px^2 and mm^2.
  Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor> by_level;
  Vector2d by_levels = Vector2d::Zero();  // derivative of the sum of all these variances
  Eigen::VectorXd residual;               // M
  std::vector<std::int32_t> row;          // M: a table row of the sighting
  // k x k, of J'J: what noise alone is expected to give, of pixels and of segment ends. Rows that leave a
  // motion free have no more than that of it. Zero where levels are not known (geometric weights).
  TangentMatrix from_noise[2];
  // k: derivative of half the cost's gradient by the logarithm of px^2 / mm^2, expected.
  Eigen::VectorXd by_ratio;
};
WhiteResiduals white_residuals(const Table& table, const bool* chosen, const Transform& at,
                               const Options& options);

// Likewise of a mix. chosen: of its sightings; `row` holds each one's first point.
WhiteResiduals white_residuals(const MixedTable& table, const bool* chosen, const Transform& at,
                               const Options& options);

// (J'J)^-1; no number where a motion is free.
TangentMatrix inverse_information(const WhiteJacobian& jacobian);

}  // namespace sonocal
