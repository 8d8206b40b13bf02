#include "sonocal/estimate/lines_agreement.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sonocal/solvers/gauss_newton.hpp"

namespace sonocal {
namespace {

// Pairs that are looked at, about; every source is held against as many targets, two at least where they are
// few.
constexpr int kPairs = 120, kMostPairs = 600, kFewestShifts = 2;
// Of a number of rare events: two standard deviations of it, and of none at all.
constexpr double kMargin = 2.0;

// How many of so many pairs are within the limit, two standard deviations above: of a sighting's points, by
// the mean of their squared distances from another's line.
double share_at_most(const Table& table, const Sightings& sightings, const Transform& transform,
                     double limit) {
  const Matrix3d linear = transform.linear();
  const int count = sightings.size(), shifts = std::max(kFewestShifts, 1 + kPairs / count);
  const int step = 1 + shifts * count / kMostPairs;
  int near = 0, pairs = 0;
  for (int shift = 0; shift < shifts; ++shift) {
    const int away = 1 + (2 * shift + 1) * (count - 1) / (2 * shifts);
    for (int i = shift % step; i < count; i += step, ++pairs) {
      const int other = i + away < count ? i + away : i + away - count;
      const double* ends = table.segments + 6 * static_cast<std::ptrdiff_t>(*sightings[other].begin());
      const Eigen::Map<const Vector3d> start(ends), end(ends + 3);
      const Vector3d along = end - start, offset = transform.translation - start;
      double sum = 0;
      for (const int row : sightings[i]) {
        const Eigen::Map<const Vector3d> point(table.points + 3 * static_cast<std::ptrdiff_t>(row));
        sum += cross(linear * point + offset, along).squaredNorm();
      }
      near += sum <= limit * along.squaredNorm() * sightings[i].size();
    }
  }
  return (near + kMargin * std::sqrt(near + 1.0) + kMargin) / std::max(pairs, 1);
}

// Mean squared distance of the mapped points from their centre.
double square_size(const Table& table, const Transform& transform) {
  const Matrix3d linear = transform.linear();
  Vector3d sum = Vector3d::Zero();
  double squares = 0;
  for (int row = 0; row < table.rows; ++row) {
    const Eigen::Map<const Vector3d> point(table.points + 3 * static_cast<std::ptrdiff_t>(row));
    const Vector3d mapped = linear * point;
    sum += mapped;
    squares += mapped.squaredNorm();
  }
  return (squares - sum.squaredNorm() / table.rows) / table.rows;
}

}  // namespace

Agreement agreement(const Table& table, const Transform& transform, const double* squares, double limit) {
  const Sightings sightings = sightings_of(table);
  std::vector<double> points, planes;
  std::vector<std::int32_t> first{0};
  for (int i = 0; i < sightings.size(); ++i) {
    for (const int row : sightings[i]) {
      const Eigen::Map<const Vector3d> point(table.points + 3 * static_cast<std::ptrdiff_t>(row));
      const double* ends = table.segments + 6 * static_cast<std::ptrdiff_t>(row);
      const Eigen::Map<const Vector3d> start(ends), end(ends + 3);
      std::array<PointOnPlane, 2> both;
      planes_of_line(point, start, (end - start).normalized(), both.data());
      for (const PointOnPlane& one : both) {
        points.insert(points.end(), one.point.data(), one.point.data() + 3);
        planes.insert(planes.end(), one.normal.data(), one.normal.data() + 3);
        planes.push_back(one.offset);
      }
    }
    first.push_back(static_cast<std::int32_t>(points.size() / 3));
  }
  return agreement(Correspondences{points.data(), planes.data(), first.data(), sightings.size()}, transform,
                   squares, limit);
}

bool plainly_more(const Table& table, const Transform& transform, const double* squares, double limit) {
  const Sightings sightings = sightings_of(table);
  const int count = sightings.size();
  int agreeing = 0, rows = 0;
  double furthest = 0;
  for (int i = 0; i < count; ++i) {
    double worst = 0;
    for (const int row : sightings[i]) worst = std::max(worst, squares[row]);
    if (!(worst <= limit)) continue;
    ++agreeing;
    rows += 2 * sightings[i].size();
    furthest = std::max(furthest, worst);
  }
  if (agreeing == 0) return false;
  // Such a threshold may take for agreeing what has only shrunk.
  if (limit > kShrunk * kShrunk * square_size(table, transform)) return false;
  const int sample = sample_of(agreeing, rows);
  if (agreeing <= sample) return false;
  return log_alarms(count, agreeing, sample, share_at_most(table, sightings, transform, furthest)) <= kSure;
}

}  // namespace sonocal
