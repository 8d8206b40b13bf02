// Multipliers of all the quadrics that the columns of a rotation or a similarity satisfy.
#pragma once

#include "sonocal/linalg/semidefinite.hpp"
#include "sonocal/linalg/transform.hpp"

namespace sonocal {

// With W = q q' of the quaternion of S = s R(q), s = |q|^2, the entries of S and s are linear in those of W,
// and the cost is a polynomial f of degree 4 in q. At the answer q is (1, 0, 0, 0). That none is less than
// the answer's is shown by
//
//     f(q) - f(1, 0, 0, 0) = z' K z + m' M m,   K >= 0,  M >= 0,   z = (S, s) - (I, 1),  m = (q1, q2, q3):
//
// a sum of squares. The 2 x 2 minors of W vanish, so that K is given up to multiples of them: 14 have no
// slope at the answer, and W_00 W_ij - W_0i W_0j, i, j = 1..3, has that of W_ij: it comes with M_ij.
//
// `plain`: K by S alone, with the multipliers of the columns' lengths and angles that the slope at the answer
// gives. Returned is the greatest least eigenvalue of K and M, as greatest_least_eigenvalue.
//
// Source: Parrilo, Semidefinite programming relaxations for semialgebraic problems, 2003.
LeastEigenvalue least_of_similarities(const Eigen::Matrix<double, 9, 9>& plain, double tolerance);

// Of a known scale |q| is one, and f is homogeneous with s = |q|^2 for the 1: z = S - I, and there is no M.
LeastEigenvalue least_of_rotations(const Eigen::Matrix<double, 9, 9>& plain, double tolerance);

// A symmetric matrix of which entry `which` of the upper triangle is 1.
inline Matrix3d symmetric_unit(int which) {
  constexpr int kRow[] = {0, 1, 2, 0, 0, 1}, kColumn[] = {0, 1, 2, 1, 2, 2};
  Matrix3d out = Matrix3d::Zero();
  out(kRow[which], kColumn[which]) = out(kColumn[which], kRow[which]) = 1;
  return out;
}

}  // namespace sonocal
