#include "sonocal/places/posed_rows.hpp"

#include <cmath>

namespace sonocal {
namespace {

using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;

}  // namespace

bool PosedTarget::nothing_known() const { return std::isinf(sigma); }

PosedRows::PosedRows(const PosedTable& table, int only_target) : dimension_(table.dimension) {
  std::vector<int> chosen;
  for (int i = 0; i < table.count; ++i)
    if (only_target < 0 || table.target[i] == only_target) chosen.push_back(i);
  const double part = 1.0 / std::max<std::size_t>(chosen.size(), 1);
  Normalisation& n = normalisation_;
  for (int i : chosen) n.image_centre += part * Eigen::Map<const Vector3d>(table.points + 3 * i);
  double of_image = 0, of_poses = 0;
  std::vector<Vector3d> origins(table.targets, Vector3d::Zero());
  std::vector<int> seen(table.targets, 0);
  std::vector<Vector3d> markers;  // the probe's, in the target's frame
  for (int i : chosen) {
    of_image += part * (Eigen::Map<const Vector3d>(table.points + 3 * i) - n.image_centre).squaredNorm();
    const Eigen::Map<const RowMajor34> pose(table.poses + 12 * i);
    markers.push_back(-pose.leftCols<3>().transpose() * pose.col(3));
    origins[table.target[i]] += markers.back();
    ++seen[table.target[i]];
  }
  for (int k = 0; k < table.targets; ++k)
    if (seen[k]) origins[k] /= seen[k];
  for (std::size_t j = 0; j < chosen.size(); ++j)
    of_poses += part * (markers[j] - origins[table.target[chosen[j]]]).squaredNorm();
  n.image_size = of_image > 0 ? std::sqrt(of_image) : 1;
  // Probes that turn where they are have no such size: a hand's is as good.
  n.size = std::max(std::sqrt(of_poses), 30.0);
  for (int i : chosen) {
    const Eigen::Map<const RowMajor34> pose(table.poses + 12 * i);
    const int k = only_target < 0 ? table.target[i] : 0;
    PosedRow row;
    row.x = (Eigen::Map<const Vector3d>(table.points + 3 * i) - n.image_centre) / n.image_size;
    row.rotation = pose.leftCols<3>();
    row.translation = (pose.col(3) + row.rotation * origins[table.target[i]]) / n.size;
    row.spin.setZero();
    row.drift.setZero();
    if (table.changes) {
      const Eigen::Map<const RowMajor34> change(table.changes + 12 * i);
      row.spin = change.leftCols<3>();
      row.drift = change.col(3) / n.size;
    }
    row.target = k;
    row.group = table.group[i];
    rows_.push_back(row);
  }
  for (int k = 0; k < table.targets; ++k) {
    if (only_target >= 0 && k != only_target) continue;
    PosedTarget target;
    target.sigma = table.sigma_mm[k] / n.size;
    target.sigma_rad = table.sigma_rad[k];
    target.body = table.body[k];
    target.origin = origins[k] / n.size;
    target.prior.spans = table.spans[k];
    if (target.nothing_known()) {
      target.prior = place_along(table.spans[k], Vector3d::UnitZ());
    } else {
      double spanning[9];
      for (int j = 0; j < 3 * table.spans[k]; ++j)
        spanning[j] = table.spanning[9 * k + j] / n.size - target.origin[j % 3];
      target.prior = place_through(table.spans[k], spanning);
    }
    targets_.push_back(target);
  }
}

Place PosedRows::to_original(const Place& place, int target) const {
  Place out = place;
  out.base = (place.base + targets_[target].origin) * normalisation_.size;
  return out;
}

Unknowns::Unknowns(const PosedRows& rows, int scales_of, bool lag_of) : scales(scales_of), lag(lag_of) {
  count = 6 + scales + lag;
  for (int k = 0; k < rows.targets(); ++k) {
    const bool known = rows.target(k).known();
    offset.push_back(known ? -1 : count);
    if (!known) count += rows.target(k).prior.freedom();
  }
}

int linearise(const PosedRows& rows, const Unknowns& unknowns, const PlacesAnswer& at, int i,
              double* residual, double* jacobian) {
  const PosedRow& row = rows.row(i);
  const Place& place = at.places[row.target];
  const Matrix3d linear = at.a.linear();
  const Vector3d arm = linear * row.x, there = arm + at.a.translation;
  const Vector3d changed = row.spin * there + row.drift;
  const Vector3d y = row.rotation.transpose() * (there - row.translation) + at.lag * changed;
  std::fill_n(jacobian, place.normals() * unknowns.count, 0.0);
  for (int k = 0; k < place.normals(); ++k) {
    double* out = jacobian + k * unknowns.count;
    const Vector3d normal = place.axes.col(k);
    residual[k] = normal.dot(y - place.base);
    const Vector3d g = row.rotation * normal + at.lag * (row.spin.transpose() * normal);
    Eigen::Map<Vector3d> turned(out), shifted(out + 3);
    turned = cross(arm, g);
    shifted = g;
    if (unknowns.scales == 1)
      out[6] = g.dot(arm);
    else
      for (int axis = 0; axis < unknowns.scales; ++axis)
        out[6 + axis] = row.x[axis] * g.dot(linear.col(axis));
    if (unknowns.lag) out[unknowns.lag_at()] = normal.dot(changed);
    if (unknowns.offset[row.target] >= 0) by_place(place, y, k, out + unknowns.offset[row.target]);
  }
  return place.normals();
}

PlacesAnswer moved(const PosedRows& rows, const Unknowns& unknowns, const PlacesAnswer& at,
                   const double* step) {
  PlacesAnswer now = at;
  now.a.rotation = orthonormal(rotation_by(Eigen::Map<const Vector3d>(step)) * at.a.rotation);
  now.a.translation += Eigen::Map<const Vector3d>(step + 3);
  if (unknowns.scales == 1)
    now.a.scales *= std::exp(step[6]);
  else
    for (int axis = 0; axis < unknowns.scales; ++axis) now.a.scales[axis] *= std::exp(step[6 + axis]);
  if (unknowns.lag) now.lag += step[unknowns.lag_at()];
  for (int k = 0; k < rows.targets(); ++k)
    if (unknowns.offset[k] >= 0) now.places[k] = moved(at.places[k], step + unknowns.offset[k]);
  return now;
}

}  // namespace sonocal
