#include "sonocal/solvers/linear.hpp"

#include <cmath>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

struct Sums {
  Vector3d image = Vector3d::Zero();
  double image_square = 0;
  Matrix3d normals = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
};

// The unit vector that the rows annihilate best, in coordinates of order one: columns of S, t, 1.
template <int kColumns>
Eigen::Matrix<double, 3 * kColumns + 4, 1> null_vector(const double* points, const double* planes,
                                                       std::size_t rows, const Vector3d& image_centre,
                                                       double image_size, const Vector3d& centre, double size,
                                                       double& condition) {
  constexpr int kSize = 3 * kColumns + 4, kEven = kSize + kSize % 2;  // registers hold two
  Eigen::Matrix<double, kEven, kEven> normal = Eigen::Matrix<double, kEven, kEven>::Zero();
  Eigen::Matrix<double, kEven, 1> row = Eigen::Matrix<double, kEven, 1>::Zero();
  for (std::size_t i = 0; i < rows; ++i) {
    const Eigen::Map<const Vector3d> x(points + 3 * i), n(planes + 4 * i);
    const Vector3d local = (x - image_centre) / image_size;
    for (int c = 0; c < kColumns; ++c) row.template segment<3>(3 * c) = local[c] * n;
    row.template segment<3>(3 * kColumns) = n;
    row[kSize - 1] = (planes[4 * i + 3] + n.dot(centre)) / size;
    for (int c = 0; c < kSize; ++c) normal.col(c) += row[c] * row;
  }
  const SymmetricEigen eigen = symmetric_eigen(normal.template topLeftCorner<kSize, kSize>());
  condition = std::sqrt(std::fmax(0.0, eigen.values[1]) / eigen.values[kSize - 1]);
  return eigen.vectors.col(0);
}

}  // namespace

bool project_to_similarity(const Matrix3d& s, bool planar, Transform& out) {
  // Gram-Schmidt is the QR decomposition with a positive diagonal.
  const double r00 = s.col(0).norm();
  out.rotation.col(0) = s.col(0) / r00;
  const Vector3d second = s.col(1) - out.rotation.col(0) * out.rotation.col(0).dot(s.col(1));
  const double r11 = second.norm();
  out.rotation.col(1) = second / r11;
  out.rotation.col(1) -= out.rotation.col(0) * out.rotation.col(0).dot(out.rotation.col(1));
  out.rotation.col(1).normalize();
  out.rotation.col(2) = cross(out.rotation.col(0), out.rotation.col(1));
  const double r22 = planar ? 0.5 * (r00 + r11) : out.rotation.col(2).dot(s.col(2));
  out.scales.setConstant((r00 + r11 + r22) / 3.0);
  return r22 > 0 && std::isfinite(out.rotation.sum()) && std::isfinite(out.scales[0]);
}

bool linear_similarity(const double* points, const double* planes, std::size_t rows, bool planar,
                       Transform& out, double& condition) {
  Sums sums;
  for (std::size_t i = 0; i < rows; ++i) {
    const Eigen::Map<const Vector3d> x(points + 3 * i), n(planes + 4 * i);
    sums.image += x / static_cast<double>(rows);
    sums.normals.noalias() += n * n.transpose();
    sums.right.noalias() -= planes[4 * i + 3] * n;
  }
  const Vector3d centre = Ldlt<3>(sums.normals).solve(sums.right);  // nearest to all planes
  double size = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    const Eigen::Map<const Vector3d> x(points + 3 * i), n(planes + 4 * i);
    sums.image_square += (x - sums.image).squaredNorm();
    size += std::pow(planes[4 * i + 3] + n.dot(centre), 2);
  }
  const double image_size = std::sqrt(sums.image_square / rows);
  size = std::sqrt(size / rows);
  condition = 0;
  if (!(image_size > 0) || !(size > 0) || !std::isfinite(size)) return false;
  Matrix3d s = Matrix3d::Zero();
  Vector3d t;
  double one;
  if (planar) {
    const auto v = null_vector<2>(points, planes, rows, sums.image, image_size, centre, size, condition);
    s.col(0) = v.segment<3>(0);
    s.col(1) = v.segment<3>(3);
    t = v.segment<3>(6);
    one = v[9];
  } else {
    const auto v = null_vector<3>(points, planes, rows, sums.image, image_size, centre, size, condition);
    s = Eigen::Map<const Matrix3d>(v.data());
    t = v.segment<3>(9);
    one = v[12];
  }
  if (!project_to_similarity(s / one, planar, out)) return false;
  out.scales *= size / image_size;
  out.translation = centre + (size / one) * t - out.scales[0] * (out.rotation * sums.image);
  return out.scales[0] > 0 && std::isfinite(out.translation.sum());
}

}  // namespace sonocal
