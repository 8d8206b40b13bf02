// Three points on three points.
#pragma once

#include <array>

#include "sonocal/solvers/batch.hpp"

namespace sonocal {

// The similarity of least squares, in closed form: of all nine equations none is left out. With x_i and y_i
// about their means, the rotation's quaternion is the eigenvector of the greatest eigenvalue of the symmetric
// 4 x 4 matrix N of
//
//     q' N q = sum_i y_i . R(q) x_i,      s = sum_i y_i . R x_i / sum_i |x_i|^2,      t = mean y - s R mean x
//
// (Horn, Closed-form solution of absolute orientation using unit quaternions, 1987). A scale > 0 is known.
//
// False where the points or the places lie on a line, which leaves a turn about it free.
bool three_points(const std::array<Vector3d, 3>& points, const std::array<Vector3d, 3>& places, double scale,
                  Transform& out);

// The same for many problems, one solution each at most: points (size, 3, 3), places (size, 3, 3).
void three_points_batch(const double* points, const double* places, std::size_t size, double scale,
                        int threads, BatchOut out);

}  // namespace sonocal
