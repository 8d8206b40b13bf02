// Linear solutions for any number of point-plane rows.
#pragma once

#include <cstddef>

#include "sonocal/linalg/transform.hpp"

namespace sonocal {

// 3D: the 13 numbers of A up to scale from >= 12 rows, paper section 5.2 (3line3D).
// 2D (all w = 0): the 10 numbers of (c1 c2 t 1) from >= 9 rows, paper section 6.1 (5point2D).
//
// Both sides are centred and scaled. The null vector comes from the normal equations, whose error is the
// condition number squared times 1e-16: about 1e-11 of the lengths for points spread in all directions.
// The linear solution is then projected to a similarity by QR, the mean of the triangle's diagonal as s.
// `condition`: ratio of the second smallest to the largest singular value; below 1e-6 the rows leave a
// motion free, and the result means nothing. False where no similarity comes out.
bool linear_similarity(const double* points, const double* planes, std::size_t rows, bool planar,
                       Transform& out, double& condition);

// The similarity of a linear estimate (paper section 5.2), or of its first two columns (6.1); false where
// it mirrors or vanishes.
bool project_to_similarity(const Matrix3d& s, bool planar, Transform& out);

}  // namespace sonocal
