// Any independent point-plane rows: the general minimal problems, of seven rows and of six.
#pragma once

#include <array>

#include "sonocal/linalg/transform.hpp"
#include "sonocal/solvers/batch.hpp"

namespace sonocal {

// normal . (A point) + offset = 0
struct PointOnPlane {
  Vector3d point;
  Vector3d normal;
  double offset;
};

inline PointOnPlane read_row(const double* points, const double* planes, std::size_t i) {
  const double *x = points + 3 * i, *p = planes + 4 * i;
  return {{x[0], x[1], x[2]}, {p[0], p[1], p[2]}, p[3]};
}

// Similarities that bring seven points into their planes, Pi_i^T A X_i = 0 (paper eq. 4-7). The
// translation and the homogeneous 1 leave four of the seven equations; the other three are linear in S,
//
//     K_j . S = 0, j = 1..3,
//
// and with S = s R(q), q a quaternion of any length, three quadrics in q (Kukelova et al. 2016): a
// polynomial of degree 8.
//
// With kRealPart, places where the polynomial comes nearest to zero without a root follow the solutions.
//
// Returns the number of solutions written; 0 where the rows leave a motion free.
int three_quadrics(const std::array<PointOnPlane, 7>& problem, std::array<Transform, 8>& solutions,
                   NoRealRoot policy = NoRealRoot::kNothing);

// Of a known scale s six points in their planes are enough. The translation takes three of the six equations;
// the other three keep their constants,
//
//     s K_j . R(q) + k_j q'q = 0, j = 1..3,
//
// three quadrics again.
int three_quadrics(const std::array<PointOnPlane, 6>& problem, double scale,
                   std::array<Transform, 8>& solutions, NoRealRoot policy = NoRealRoot::kNothing);

// The same for many problems of as many rows or more, of which the first ones are used: points
// (size, rows, 3), planes (size, rows, 4) as (normal, offset). A scale > 0 is known.
void three_quadrics_batch(const double* points, const double* planes, std::size_t size, int rows,
                          double scale, NoRealRoot policy, int threads, BatchOut out);

}  // namespace sonocal
