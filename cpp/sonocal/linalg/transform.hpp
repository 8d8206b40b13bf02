// The unknown of every problem here: image to probe marker.
#pragma once

#include <Eigen/Core>

#include "sonocal/linalg/rotation.hpp"

namespace sonocal {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// y = R diag(scales) x + t. A similarity has three equal scales (paper eq. 2-3).
struct Transform {
  Matrix3d rotation = Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
  Vector3d scales = Vector3d::Ones();

  Matrix3d linear() const { return rotation * scales.asDiagonal(); }
  Vector3d apply(const Vector3d& x) const { return linear() * x + translation; }

  Matrix4d matrix() const {
    Matrix4d a = Matrix4d::Identity();
    a.topLeftCorner<3, 3>() = linear();
    a.topRightCorner<3, 1>() = translation;
    return a;
  }
};

inline Matrix3d cross_matrix(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// Two unit normals of a line's direction: the line is where their planes meet. Needs no origin, so a
// needle that points at the marker's origin is no special case (the paper's own choice of planes,
// section 9, breaks there).
inline void perpendicular_basis(const Vector3d& direction, Vector3d& n1, Vector3d& n2) {
  int smallest;
  direction.cwiseAbs().minCoeff(&smallest);
  n1 = cross(direction, Vector3d::Unit(smallest)).normalized();
  n2 = cross(direction, n1);
}

}  // namespace sonocal
