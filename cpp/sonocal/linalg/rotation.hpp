// Cross products and rotations. Eigen's own header for them takes long to compile and brings much else.
#pragma once

#include <Eigen/Core>

namespace sonocal {

inline Eigen::Vector3d cross(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline double determinant(const Eigen::Matrix3d& a) { return a.col(0).dot(cross(a.col(1), a.col(2))); }

// About the vector, by its length in rad (Rodrigues' formula).
Eigen::Matrix3d rotation_by(const Eigen::Vector3d& turn);

// The nearest rotation of one that many products have let drift.
Eigen::Matrix3d orthonormal(const Eigen::Matrix3d& nearly);

}  // namespace sonocal
