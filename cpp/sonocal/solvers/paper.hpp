// The paper's minimal solvers as the paper gives them; faster and steadier ones stand beside.
#pragma once

#include <array>

#include "sonocal/solvers/four_points.hpp"

namespace sonocal {

// 2line3D, paper section 5.3: four points on four lines in space, two of them on one line each for two
// line-line correspondences. Seven of the eight equations by SVD leave
//     A = a A_a + b A_b + c A_c + d A_d + e A_e + f A_f     (eq. 12), f = 1,
// the ten quadrics (13) times 1, a, b, c, d are 50 equations of rank 47 in 55 monomials, LU leaves 5 in the
// 13 monomials (15)-(16), and the eigenvectors of b's 8 x 8 action matrix (17) the solutions.
struct SpacePointOnLine {
  Vector3d image, point, direction;
};
//
// Noise leaves complex pairs; with kRealPart each gives the real part of its first vector.
int paper_two_lines(const std::array<SpacePointOnLine, 4>& problem, std::array<Transform, 8>& solutions,
                    NoRealRoot policy = NoRealRoot::kNothing);

// 4point2D, paper section 6.2: (c1 c2 t 1) in a three-dimensional subspace (22), two quadrics (23), the 2 x 6
// system (24)-(26) and a 4 x 4 action matrix.
int paper_four_points(const std::array<PointOnLine, 4>& problem, std::array<Transform, 4>& solutions,
                      NoRealRoot policy = NoRealRoot::kNothing);

}  // namespace sonocal
