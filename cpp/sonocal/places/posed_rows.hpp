// Sightings of targets whose place is asked for: each with the pose of the probe relative to the target.
#pragma once

#include <cstdint>
#include <vector>

#include "sonocal/estimate/point_lines.hpp"
#include "sonocal/places/place.hpp"

namespace sonocal {

// Raw arrays that outlive the call, checked.
struct PosedTable {
  const double* points;       // N x 3, px; w = 0 for a 2D probe
  const double* poses;        // N x 3 x 4: probe_from_target, mm
  const double* changes;      // N x 3 x 4: derivative of target_from_probe by the lag, per second; null: none
  const std::int32_t* group;  // N, never less than the one before: rows of one instant
  const std::int32_t* target;  // N
  int count;
  int dimension;
  // A target each:
  const std::int32_t* spans;
  const double* spanning;    // x 3 x 3, mm
  const double* sigma_mm;    // how well that is known: 0 exactly, infinity not at all
  const double* sigma_rad;   // likewise of its direction
  const std::int32_t* body;  // the marker that it is fixed to, from 0; -1: nothing that is tracked
  int targets;
};

struct PosedRow {
  Vector3d x;
  Matrix3d rotation;  // probe_from_target
  Vector3d translation;
  Matrix3d spin;  // derivatives of target_from_probe by the lag
  Vector3d drift;
  int target, group;
};

struct PosedTarget {
  Place prior;
  double sigma, sigma_rad;
  int body;
  Vector3d origin;  // of the coordinates that rows are in, in the marker's
  bool known() const { return sigma == 0 && sigma_rad == 0; }
  bool nothing_known() const;
};

// What is asked for. The calibration's tangent comes first, then the lag where it is asked for, then the
// places.
struct PlacesAnswer {
  Transform a;
  std::vector<Place> places;
  double lag = 0;
};

// In coordinates of order one, each target's about where its marker saw the probe.
class PosedRows {
 public:
  explicit PosedRows(const PosedTable& table, int only_target = -1);

  int size() const { return static_cast<int>(rows_.size()); }
  int dimension() const { return dimension_; }
  const PosedRow& row(int i) const { return rows_[i]; }
  PosedRow& row(int i) { return rows_[i]; }
  int targets() const { return static_cast<int>(targets_.size()); }
  const PosedTarget& target(int k) const { return targets_[k]; }
  const Normalisation& normalisation() const { return normalisation_; }

  // Where a row's point is, in its target's coordinates.
  Vector3d seen(const Transform& a, double lag, int i) const {
    const PosedRow& row = rows_[i];
    const Vector3d there = a.apply(row.x);
    return row.rotation.transpose() * (there - row.translation) + lag * (row.spin * there + row.drift);
  }
  double square(const PlacesAnswer& at, int i) const {
    return at.places[rows_[i].target].square(seen(at.a, at.lag, i));
  }
  Place to_original(const Place& place, int target) const;

 private:
  int dimension_;
  Normalisation normalisation_;
  std::vector<PosedRow> rows_;
  std::vector<PosedTarget> targets_;
};

// Which numbers of an answer are asked for, and where in a tangent each is.
struct Unknowns {
  int scales;  // of the calibration: 1, or 2
  bool lag;
  std::vector<int> offset;  // of each target's place; -1: it is known
  int count;
  Unknowns(const PosedRows& rows, int scales, bool lag);
  int lag_at() const { return 6 + scales; }
};

// Residuals of a row, in mm of the rows, and their derivatives, row-major (normals x unknowns).
int linearise(const PosedRows& rows, const Unknowns& unknowns, const PlacesAnswer& at, int i,
              double* residual, double* jacobian);
PlacesAnswer moved(const PosedRows& rows, const Unknowns& unknowns, const PlacesAnswer& at,
                   const double* step);

}  // namespace sonocal
