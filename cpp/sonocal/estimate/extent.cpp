#include "sonocal/estimate/extent.hpp"

#include <cmath>
#include <vector>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

using RowVectors = std::vector<Vector3d>;

Vector3d mean(const RowVectors& vectors) {
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& v : vectors) sum += v;
  return sum / static_cast<double>(vectors.size());
}

void add_square(const Vector3d& v, Matrix3d& sum) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) sum(i, j) += v[i] * v[j];
}

Vector3d principal_extents(const RowVectors& vectors) {
  const Vector3d centre = mean(vectors);
  Matrix3d square = Matrix3d::Zero();
  for (const Vector3d& v : vectors) add_square(v - centre, square);
  const SmallVector values = symmetric_eigenvalues(square);
  Vector3d out;
  for (int i = 0; i < 3; ++i)
    out[i] = std::sqrt(std::max(values[2 - i], 0.0) / static_cast<double>(vectors.size()));
  return out;
}

// The least-squares meeting point of lines, each by a point of it and its direction.
void meet(const RowVectors& from, const RowVectors& along, const Matrix3d& square, Extent& out) {
  const auto count = static_cast<double>(from.size());
  const Vector3d centre = mean(from);
  RowVectors feet;
  Vector3d sum = Vector3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vector3d away = from[i] - centre;
    feet.push_back(away - away.dot(along[i]) * along[i]);
    sum += feet.back();
  }
  const Vector3d nearest = Ldlt<3>(count * Matrix3d::Identity() - square).solve<1>(sum);
  double squares = 0;
  for (std::size_t i = 0; i < feet.size(); ++i)
    squares += (feet[i] - nearest + along[i].dot(nearest) * along[i]).squaredNorm();
  out.meeting = nearest + centre;
  out.meeting_distance = std::sqrt(squares / count);
}

}  // namespace

Extent extent_of(const Table& table, const bool* chosen) {
  RowVectors points, from, along, ends;
  Matrix3d square = Matrix3d::Zero();
  for (int i = 0; i < table.rows; ++i) {
    if (chosen && !chosen[i]) continue;
    points.emplace_back(table.points + 3 * i);
    from.emplace_back(table.segments + 6 * i);
    ends.push_back(from.back());
    ends.emplace_back(table.segments + 6 * i + 3);
    along.push_back((ends.back() - from.back()).normalized());
    add_square(along.back(), square);
  }
  Extent out;
  const SymmetricEigen of = symmetric_eigen(square);
  for (int i = 0; i < 3; ++i) out.common[i] = of.vectors(i, 2);
  const double across = (of.values[0] + of.values[1]) / static_cast<double>(along.size());
  out.direction_spread = std::sqrt(std::max(across, 0.0));
  meet(from, along, square, out);
  out.ends = principal_extents(ends);
  out.points = principal_extents(points);
  return out;
}

}  // namespace sonocal
