#include "sonocal/estimate/targets.hpp"

#include <cmath>

#include "sonocal/linalg/small.hpp"

namespace sonocal {

Target target_of(const double* spanning, int count) {
  Target target;
  const Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>> points(spanning, 3, count);
  target.middle = points.rowwise().mean();
  target.shared = 1.0 / count;
  target.reaches = count - 1;
  target.normals = 4 - count;
  // With Q the points about their middle, b = 1 / K + Q^+ (y - middle): the axes of Q Q' are those of the
  // hull.
  Matrix3d spread = Matrix3d::Zero();
  for (int l = 0; l < count; ++l) {
    const Vector3d arm = points.col(l) - target.middle;
    spread += arm * arm.transpose();
  }
  const SymmetricEigen axes = symmetric_eigen(spread);
  for (int k = 0; k < target.normals; ++k) target.normal[k] = axes.vectors.col(k);
  for (int k = 0; k < target.reaches; ++k)
    target.reach[k] = axes.vectors.col(2 - k) / std::sqrt(axes.values[2 - k]);
  return target;
}

}  // namespace sonocal
