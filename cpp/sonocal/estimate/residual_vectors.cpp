#include "sonocal/estimate/residual_vectors.hpp"

namespace sonocal {

std::vector<double> residual_vectors(const Table& table, const Transform& at) {
  const Matrix3d linear = at.linear();
  std::vector<double> out(3 * static_cast<std::size_t>(table.rows));
  for (int i = 0; i < table.rows; ++i) {
    const Eigen::Map<const Vector3d> x(table.points + 3 * i), first(table.segments + 6 * i),
        last(table.segments + 6 * i + 3);
    const Vector3d along = (last - first).normalized();
    const Vector3d away = linear * x + (at.translation - first);
    Eigen::Map<Vector3d>(out.data() + 3 * i) = away - away.dot(along) * along;
  }
  return out;
}

}  // namespace sonocal
