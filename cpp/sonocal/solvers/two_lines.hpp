// Two lines on two lines: the minimal problem of a 3D probe.
#pragma once

#include <array>

#include "sonocal/linalg/transform.hpp"
#include "sonocal/solvers/batch.hpp"

namespace sonocal {

struct Line {
  Vector3d point;
  Vector3d direction;  // unit; its sign has no meaning
};

// Similarities that carry two image lines onto two needles, A B_i = L_i. Closed form of the problem
// of paper section 5: the directions give R up to half a turn about the common perpendicular, the
// lengths of the common perpendiculars give s, their feet give t. All 8 equations are used: an angle
// or a length that disagrees is shared between both lines.
//
// A line's direction has no sign, so the angle between two lines is theirs or its supplement; only
// one of the two gives s > 0. Returns 2, or 0 where two lines are parallel or meet.
int two_lines(const std::array<Line, 2>& image, const std::array<Line, 2>& needles,
              std::array<Transform, 2>& solutions);

// The same for many problems: both (size, 2, 2, 3), px and mm.
void two_lines_batch(const double* image, const double* needles, std::size_t size, int threads, BatchOut out);

}  // namespace sonocal
