#include <Eigen/Eigenvalues>

#include "sonocal/linalg/small.hpp"

namespace sonocal {

GeneralEigen general_eigen(const SmallMatrix& a) {
  const Eigen::EigenSolver<SmallMatrix> solver(a);
  if (solver.info() != Eigen::Success) return {};
  GeneralEigen out;
  out.found = true;
  out.real = solver.eigenvalues().real();
  out.imaginary = solver.eigenvalues().imag();
  out.vectors = solver.pseudoEigenvectors();
  return out;
}

}  // namespace sonocal
