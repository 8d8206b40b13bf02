// Sightings of points, lines and planes, in any mix.
#pragma once

#include <cstdint>
#include <vector>

#include "sonocal/estimate/noise_model.hpp"
#include "sonocal/estimate/targets.hpp"

namespace sonocal {

// Raw arrays that outlive the call. A sighting is one target, and points that the image shows of it.
struct MixedTable {
  const double* points;       // N x 3, px; w = 0 for a 2D probe
  const std::int32_t* first;  // count + 1: sighting c has the points first[c] up to first[c + 1]
  const double* spanning;     // count x 3 x 3, mm: as many rows of three as span the target
  const std::int32_t* spans;  // count: 1 a point, 2 a line, 3 a plane
  RowNoise noise;             // px: N, mm: count
  int count;
  int dimension;
};

// The same in coordinates of order one.
class MixedRows {
 public:
  explicit MixedRows(const MixedTable& table);

  int size() const { return static_cast<int>(targets_.size()); }
  int dimension() const { return table_.dimension; }
  const Normalisation& normalisation() const { return normalisation_; }
  const Target& target(int sighting) const { return targets_[sighting]; }
  int first(int sighting) const { return table_.first[sighting]; }
  int points(int sighting) const { return first(sighting + 1) - first(sighting); }
  const Vector3d& point(int i) const { return points_[i]; }
  double px_factor(int i) const { return table_.noise.px ? table_.noise.px[i] : 1.0; }
  double mm_factor(int sighting) const { return table_.noise.mm ? table_.noise.mm[sighting] : 1.0; }

  // Mean squared distance of a sighting's points from its target.
  double square(const Transform& a, int sighting) const;

 private:
  const MixedTable& table_;
  Normalisation normalisation_;
  std::vector<Vector3d> points_;
  std::vector<Target> targets_;
};

}  // namespace sonocal
