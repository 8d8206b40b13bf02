#include <Eigen/Eigenvalues>

#include "sonocal/linalg/small.hpp"

namespace sonocal {

SymmetricEigen symmetric_eigen(const SmallMatrix& a) {
  const Eigen::SelfAdjointEigenSolver<SmallMatrix> solver(a);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

SmallVector symmetric_eigenvalues(const SmallMatrix& a) {
  return Eigen::SelfAdjointEigenSolver<SmallMatrix>(a, Eigen::EigenvaluesOnly).eigenvalues();
}

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
