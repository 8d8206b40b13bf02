// Four points of a plane on four lines: the minimal problem of a 2D probe.
#pragma once

#include <array>

#include "sonocal/linalg/transform.hpp"
#include "sonocal/solvers/batch.hpp"

namespace sonocal {

struct PointOnLine {
  Vector2d image;      // px
  Vector3d point;      // mm, anywhere on the line
  Vector3d direction;  // unit
};

// Similarities with A x_i on line i, i = 1..4, by 7 of the 8 equations: the fourth point of the
// chosen elimination is held to one plane through its line only. Two conics
//
//     |c1|^2 - |c2|^2 = 0,   c1 . c2 = 0
//
// in two unknowns, a quartic, up to 4 solutions. Paper section 6.2, eq. (20)-(21), with the linear
// part eliminated by the affine dependency of four coplanar points.
//
// Returns the number of solutions written; 0 where three of the points or the lines leave no
// elimination.
int four_points(const std::array<PointOnLine, 4>& problem, std::array<Transform, 4>& solutions,
                NoRealRoot policy = NoRealRoot::kNothing);

// The same for many problems, up to 4 solutions each: points (size, 4, 2) px, segments (size, 4, 2, 3) mm.
void four_points_batch(const double* points, const double* segments, std::size_t size, NoRealRoot policy,
                       int threads, BatchOut out);

}  // namespace sonocal
