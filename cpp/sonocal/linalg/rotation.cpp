#include "sonocal/linalg/rotation.hpp"

#include <cmath>

#include "sonocal/linalg/product.hpp"

namespace sonocal {

Eigen::Matrix3d rotation_by(const Eigen::Vector3d& turn) {
  const double angle = turn.norm();
  Eigen::Matrix3d out = Eigen::Matrix3d::Identity();
  if (!(angle > 0)) return out;
  const double sine = std::sin(angle) / angle, half = std::sin(0.5 * angle) / angle, lost = 2 * half * half;
  for (int column = 0; column < 3; ++column) {
    const int next = (column + 1) % 3, last = (column + 2) % 3;
    out(column, column) -= lost * (turn[next] * turn[next] + turn[last] * turn[last]);
    out(next, column) = lost * turn[next] * turn[column] + sine * turn[last];
    out(last, column) = lost * turn[last] * turn[column] - sine * turn[next];
  }
  return out;
}

// Two steps of Newton's method for the polar factor: drifts of 1e-4 are 1e-16 then.
Eigen::Matrix3d orthonormal(const Eigen::Matrix3d& nearly) {
  Eigen::Matrix3d out = nearly;
  for (int step = 0; step < 2; ++step) {
    Eigen::Matrix3d correction = transposed_product(out, out);
    for (int i = 0; i < 9; ++i) correction.data()[i] *= -0.5;
    for (int i = 0; i < 3; ++i) correction(i, i) += 1.5;
    out = product(out, correction);
  }
  return out;
}

}  // namespace sonocal
