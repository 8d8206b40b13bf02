// How lines and points are spread: what the configurations that leave a motion free are recognised by.
#pragma once

#include "sonocal/estimate/table.hpp"

namespace sonocal {

struct Extent {
  Vector3d common;          // the lines' common direction, a unit vector
  double direction_spread;  // root mean square angle (rad, small angles) of the lines to it
  Vector3d meeting;         // the point nearest to all lines, mm; of parallel ones any such point
  double meeting_distance;  // its root mean square distance from them, mm
  Vector3d ends,
      points;  // root mean square extents along the principal axes, largest first: of end points, mm; px
};

// Of the rows with chosen[i], or of all (null); one at least.
Extent extent_of(const Table& table, const bool* chosen);

}  // namespace sonocal
