// Straight things: what spans one, and how the noise of that comes to a place on it.
#pragma once

#include "sonocal/linalg/transform.hpp"

namespace sonocal {

// The affine hull of one, two or three points: a point, a line, a plane. A place y on it is
//     y = sum_l b_l p_l,   sum_l b_l = 1,
// and noise of the spanning points, alike along every axis, comes to places y and y' with the covariance
//     sum_l b_l b'_l = shared + sum_k (reach_k . (y - middle)) (reach_k . (y' - middle)).
struct Target {
  int normals = 0;     // 3: a point, 2: a line, 1: a plane
  int reaches = 0;     // 0, 1, 2
  Vector3d normal[3];  // orthonormal, at right angles to it
  Vector3d reach[2];
  Vector3d middle;    // of the spanning points
  double shared = 1;  // one part in as many as they are
};

// spanning: count x 3, row-major; two that differ, three that are not on one line.
Target target_of(const double* spanning, int count);

}  // namespace sonocal
