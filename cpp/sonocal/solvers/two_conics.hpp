// Any seven independent point-plane rows of a 2D probe.
#pragma once

#include "sonocal/solvers/three_quadrics.hpp"

namespace sonocal {

// Similarities that bring seven points of an image into their planes, Pi_i^T A (u_i, v_i, 0, 1) = 0: lines of
// an image in planes, points in planes, points on lines and on points, whatever a probe saw. The translation
// takes three of the seven equations; the other four leave a plane of (c1, c2), the first two columns of S,
//
//     (c1, c2) = (c1, c2)_0 + alpha (c1, c2)_1 + mu (c1, c2)_2,      |c1|^2 - |c2|^2 = 0,   c1 . c2 = 0:
//
// two conics, a quartic, up to 4 solutions (paper eq. 20-21). The eight of three_quadrics are these and
// their turns by 180 deg about c3, whose scales are negative.
//
// Many problems of `rows` >= 7 rows, the first seven of which are used: points (size, rows, 3) whose third
// coordinates are not read, planes (size, rows, 4) as (normal, offset). Up to 4 solutions each, then, with
// kRealPart, the real part of each complex pair.
void two_conics_batch(const double* points, const double* planes, std::size_t size, int rows,
                      NoRealRoot policy, int threads, BatchOut out);

}  // namespace sonocal
