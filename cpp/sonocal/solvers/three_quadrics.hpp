// Any seven independent point-plane rows: the general minimal problem.
#pragma once

#include <array>

#include "sonocal/solvers/batch.hpp"
#include "sonocal/transform.hpp"

namespace sonocal {

// normal . (A point) + offset = 0
struct PointOnPlane {
  Vector3d point;
  Vector3d normal;
  double offset;
};

// Similarities that bring seven points into their planes, Pi_i^T A X_i = 0 (paper eq. 4-7). The
// translation and the homogeneous 1 leave four of the seven equations; the other three are linear in S,
// and with S = s R(q), q a quaternion of any length, three quadrics in q (Kukelova et al. 2016): a
// polynomial of degree 8.
//
// Returns the number of solutions written; 0 where the rows leave a motion free.
int three_quadrics(const std::array<PointOnPlane, 7>& problem, std::array<Transform, 8>& solutions);

// The same for many problems: points (size, 7, 3), planes (size, 7, 4) as (normal, offset).
void three_quadrics_batch(const double* points, const double* planes, std::size_t size, int threads,
                          BatchOut out);

}  // namespace sonocal
