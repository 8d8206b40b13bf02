#include "sonocal/solvers/three_points.hpp"

#include "sonocal/linalg/small.hpp"
#include "sonocal/linalg/vectors.hpp"

namespace sonocal {
namespace {

// Two eigenvalues this near to each other, beside the greatest, leave a turn free.
constexpr double kFreeTurn = 1e-10;

// sum_i y_i x_i' and its form of the quaternion (w, x, y, z).
SmallMatrix quaternion_form(const Matrix3d& m) {
  SmallMatrix n(4, 4);
  n(0, 0) = m(0, 0) + m(1, 1) + m(2, 2);
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    n(0, i + 1) = n(i + 1, 0) = m(k, j) - m(j, k);
    n(i + 1, i + 1) = m(i, i) - m(j, j) - m(k, k);
    n(i + 1, j + 1) = n(j + 1, i + 1) = m(i, j) + m(j, i);
  }
  return n;
}

Matrix3d rotation_of(const Eigen::Vector4d& q) {
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  Matrix3d out;
  out << w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),  //
      2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),     //
      2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z;
  return out;
}

}  // namespace

bool three_points(const std::array<Vector3d, 3>& points, const std::array<Vector3d, 3>& places, double scale,
                  Transform& out) {
  const Vector3d from = (points[0] + points[1] + points[2]) / 3, to = (places[0] + places[1] + places[2]) / 3;
  Matrix3d moments = Matrix3d::Zero();
  double square = 0;
  for (int i = 0; i < 3; ++i) {
    const Vector3d x = points[i] - from, y = places[i] - to;
    moments += y * x.transpose();
    square += x.squaredNorm();
  }
  const SmallMatrix form = quaternion_form(moments);
  if (!form.allFinite()) return false;
  const SymmetricEigen eigen = symmetric_eigen(form);
  const double most = eigen.values[3];
  if (!(most - eigen.values[2] > kFreeTurn * most) || !(square > 0)) return false;
  out.rotation = rotation_of(eigen.vectors.col(3).normalized());
  out.scales.setConstant(scale > 0 ? scale : most / square);
  out.translation = to - out.linear() * from;
  return out.translation.allFinite();
}

void three_points_batch(const double* points, const double* places, std::size_t size, double scale,
                        int threads, BatchOut out) {
  const auto read = [](const double* at) {
    std::array<Vector3d, 3> read;
    for (int i = 0; i < 3; ++i) read[i] = Eigen::Map<const Vector3d>(at + 3 * i);
    return read;
  };
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    solve_each<1>(begin, end, out, [&](std::size_t b, std::array<Transform, 1>& solutions) {
      return three_points(read(points + 9 * b), read(places + 9 * b), scale, solutions[0]) ? 1 : 0;
    });
  });
}

}  // namespace sonocal
