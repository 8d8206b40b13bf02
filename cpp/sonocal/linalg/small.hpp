// Matrices whose size is known at run time only, and small: on the stack, their decompositions compiled once.
#pragma once

#include <Eigen/Core>
#include <array>
#include <complex>

namespace sonocal {

// Decompositions of fixed sizes unroll every reflection, and each size anew: most of a build's time went
// there.
constexpr int kMostSide = 16;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostSide, kMostSide>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostSide, 1>;

// Of a symmetric matrix, whose lower triangle is read: values in increasing order, unit vectors in columns.
struct SymmetricEigen {
  SmallVector values;
  SmallMatrix vectors;
};
SymmetricEigen symmetric_eigen(SmallMatrix a, bool vectors = true);
inline SmallVector symmetric_eigenvalues(const SmallMatrix& a) { return symmetric_eigen(a, false).values; }

// A value of any square matrix, with its vector, whose largest entry is 1.
struct EigenPair {
  std::complex<double> value;
  SmallVector real, imaginary;
};

// The values of any square matrix; of each conjugate pair the one with the positive imaginary part. `found`
// is false where the iteration came to no end.
struct GeneralEigen {
  bool found = false;
  int count = 0;
  std::array<EigenPair, kMostSide> pairs;
};
GeneralEigen general_eigen(const SmallMatrix& a);

// Q of A = Q R, square. A has up to kMostSide columns; compiled for SmallMatrix, and for MatrixXd of any
// height.
template <class Matrix>
Matrix orthogonal_factor(Matrix a);

// x with the least |A x - b|; columns that others span have zeros in x.
SmallVector least_squares(SmallMatrix a, SmallVector b);

}  // namespace sonocal
