// Least squares over the few rows of a sample, from a given start.
#pragma once

#include <vector>

#include "sonocal/linalg/transform.hpp"
#include "sonocal/solvers/three_quadrics.hpp"

namespace sonocal {

// Both planes of a line, orthonormal: their residuals' squares add up to the squared distance.
inline void planes_of_line(const Vector3d& image, const Vector3d& point, const Vector3d& direction,
                           PointOnPlane* rows) {
  Vector3d n1, n2;
  perpendicular_basis(direction, n1, n2);
  rows[0] = {image, n1, -n1.dot(point)};
  rows[1] = {image, n2, -n2.dot(point)};
}

// sum_i (n_i . A x_i + d_i)^2
double squared_residuals(const PointOnPlane* rows, int count, const Transform& a);

// Up to `steps` damped Gauss-Newton steps on that sum; a step that does not lower it is shortened, and
// given up if that does not help, so the result is never worse than the start. `fixed_scale` > 0: the scale
// is known, and set before the first step. Returns the sum reached.
double gauss_newton(const PointOnPlane* rows, int count, int steps, double fixed_scale, Transform& a);

// Refines every candidate on all rows and sorts them by what they leave. Returns how many stay: a start
// that ends at another's result is the same solution.
int refine_candidates(const PointOnPlane* rows, int count, int steps, double fixed_scale,
                      Transform* candidates, int candidate_count);

// Refines a solved batch in place: make_rows(b, rows) fills `count` rows of problem b.
template <int kMost, class MakeRows>
void refine_batch(std::size_t size, int threads, int count, int steps, double fixed_scale, BatchOut out,
                  const MakeRows& make_rows) {
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    std::vector<PointOnPlane> rows(count);
    solve_each<kMost>(begin, end, out, [&](std::size_t b, std::array<Transform, kMost>& solutions) {
      const int given = static_cast<int>(out.counts[b]);
      if (given == 0) return 0;
      make_rows(b, rows.data());
      for (int k = 0; k < given; ++k) solutions[k] = read_row_major(out.matrices + (b * kMost + k) * 16);
      return refine_candidates(rows.data(), count, steps, fixed_scale, solutions.data(), given);
    });
  });
}

}  // namespace sonocal
