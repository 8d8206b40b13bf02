#include "sonocal/places/place.hpp"

#include <cmath>

#include "sonocal/linalg/small.hpp"

namespace sonocal {

Place place_along(int spans, const Vector3d& direction) {
  Place place;
  place.spans = spans;
  Vector3d n1, n2;
  perpendicular_basis(direction, n1, n2);
  if (spans == 2)
    place.axes << n1, n2, direction;
  else if (spans == 3)
    place.axes << direction, n1, n2;
  return place;
}

Place place_through(int spans, const double* spanning) {
  const Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>> points(spanning, 3, spans);
  Place place;
  if (spans == 2)
    place = place_along(2, (points.col(1) - points.col(0)).normalized());
  else if (spans == 3)
    place = place_along(3, cross(points.col(1) - points.col(0), points.col(2) - points.col(0)).normalized());
  place.base = points.rowwise().mean();
  return place;
}

void by_place(const Place& place, const Vector3d& y, int normal, double* row) {
  const int normals = place.normals(), reaches = place.reaches();
  std::fill_n(row, place.freedom(), 0.0);
  row[normal] = -1;
  for (int r = 0; r < reaches; ++r)
    row[normals + normal * reaches + r] = place.axes.col(normals + r).dot(y - place.base);
}

Place moved(const Place& place, const double* step) {
  const int normals = place.normals(), reaches = place.reaches();
  Place now = place;
  for (int k = 0; k < normals; ++k) now.base += step[k] * place.axes.col(k);
  // A normal that turns by a towards a reach takes the reach by -a towards itself: one rotation of all axes.
  Vector3d turn = Vector3d::Zero();
  for (int k = 0; k < normals; ++k)
    for (int r = 0; r < reaches; ++r)
      turn += step[normals + k * reaches + r] * cross(place.axes.col(k), place.axes.col(normals + r));
  now.axes = orthonormal(rotation_by(turn) * place.axes);
  return now;
}

Place based_near(Place place, const Vector3d& seen) {
  const Vector3d away = seen - place.base;
  for (int r = place.normals(); r < 3; ++r) place.base += place.axes.col(r) * place.axes.col(r).dot(away);
  return place;
}

std::vector<Vector3d> half_sphere(int count) {
  const double golden = M_PI * (3 - std::sqrt(5.0));
  std::vector<Vector3d> directions;
  for (int i = 0; i < count; ++i) {
    const double z = (i + 0.5) / count, r = std::sqrt(1 - z * z);
    directions.emplace_back(r * std::cos(golden * i), r * std::sin(golden * i), z);
  }
  return directions;
}

}  // namespace sonocal
