#include "sonocal/estimate/mixed_table.hpp"

#include <cmath>

namespace sonocal {
namespace {

// Root mean square distance from the mean, which goes to `centre`; 1 where all coincide.
double centre_and_size(const std::vector<Vector3d>& points, Vector3d& centre) {
  centre = Vector3d::Zero();
  for (const Vector3d& point : points) centre += point / static_cast<double>(points.size());
  double sum = 0;
  for (const Vector3d& point : points) sum += (point - centre).squaredNorm();
  const double size = std::sqrt(sum / static_cast<double>(points.size()));
  return size > 0 ? size : 1;
}

}  // namespace

MixedRows::MixedRows(const MixedTable& table) : table_(table) {
  Normalisation& n = normalisation_;
  for (int i = 0; i < table.first[table.count]; ++i) points_.emplace_back(table.points + 3 * i);
  n.image_size = centre_and_size(points_, n.image_centre);
  for (Vector3d& point : points_) point = (point - n.image_centre) / n.image_size;
  std::vector<Vector3d> spanning;
  for (int c = 0; c < table.count; ++c)
    for (int l = 0; l < table.spans[c]; ++l) spanning.emplace_back(table.spanning + 9 * c + 3 * l);
  n.size = centre_and_size(spanning, n.centre);
  for (Vector3d& point : spanning) point = (point - n.centre) / n.size;
  const Vector3d* of_target = spanning.data();
  for (int c = 0; c < table.count; of_target += table.spans[c], ++c)
    targets_.push_back(target_of(of_target->data(), table.spans[c]));
}

double MixedRows::square(const Transform& a, int sighting) const {
  const Target& target = targets_[sighting];
  double sum = 0;
  for (int i = first(sighting); i < first(sighting + 1); ++i) {
    const Vector3d away = a.apply(points_[i]) - target.middle;
    for (int k = 0; k < target.normals; ++k) sum += std::pow(target.normal[k].dot(away), 2);
  }
  return sum / points(sighting);
}

}  // namespace sonocal
