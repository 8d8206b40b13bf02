// Decompositions of small matrices: what defines them, and Eigen's own as an oracle.
#include <Eigen/Dense>
#include <complex>
#include <random>

#include "check.hpp"
#include "sonocal/linalg/small.hpp"

using namespace sonocal;

namespace {

SmallMatrix random_matrix(int n, std::mt19937& random) {
  std::normal_distribution<double> normal;
  return SmallMatrix::NullaryExpr(n, n, [&] { return normal(random); });
}

// Every value with its vector, and as many values as rows, conjugates counted.
void check_pairs(const SmallMatrix& a, double tolerance) {
  const int n = static_cast<int>(a.rows());
  const GeneralEigen eigen = general_eigen(a);
  check(eigen.found, "an iteration comes to an end");
  int values = 0;
  for (int k = 0; k < eigen.count; ++k) {
    const EigenPair& pair = eigen.pairs[k];
    Eigen::VectorXcd v(n);
    for (int i = 0; i < n; ++i) v[i] = {pair.real[i], pair.imaginary[i]};
    check(std::abs(v.cwiseAbs().maxCoeff() - 1) < 1e-12, "a vector's largest entry is 1");
    check((a.cast<std::complex<double>>() * v - pair.value * v).norm() < tolerance * (1 + a.norm()),
          "A v = lambda v");
    check(pair.value.imag() >= 0, "one of each pair");
    values += pair.value.imag() > 0 ? 2 : 1;
  }
  check(values == n, "as many values as rows");
  const Eigen::VectorXcd theirs = Eigen::MatrixXd(a).eigenvalues();
  for (int k = 0; k < eigen.count; ++k) {
    double nearest = 1e300;
    for (int i = 0; i < n; ++i) nearest = std::min(nearest, std::abs(theirs[i] - eigen.pairs[k].value));
    check(nearest < tolerance * (1 + a.norm()), "values are Eigen's");
  }
}

void check_general() {
  std::mt19937 random(1);
  for (int n = 1; n <= kMostSide; ++n)
    for (int trial = 0; trial < 200; ++trial) check_pairs(random_matrix(n, random), 1e-10);
  // Permutations have values on the unit circle, which turn usual shifts in a circle.
  for (int n = 2; n <= kMostSide; ++n) {
    SmallMatrix shift = SmallMatrix::Zero(n, n);
    for (int i = 0; i < n; ++i) shift((i + 1) % n, i) = 1;
    check_pairs(shift, 1e-10);
  }
  check_pairs(SmallMatrix::Identity(8, 8), 1e-12);
  check_pairs(SmallMatrix::Zero(8, 8), 1e-12);
}

void check_symmetric() {
  std::mt19937 random(2);
  for (int n = 1; n <= kMostSide; ++n)
    for (int trial = 0; trial < 200; ++trial) {
      const SmallMatrix half = random_matrix(n, random), a = half + half.transpose();
      const SymmetricEigen eigen = symmetric_eigen(a);
      const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> theirs(a);
      check((a * eigen.vectors - eigen.vectors * eigen.values.asDiagonal()).norm() < 1e-11 * (1 + a.norm()),
            "A V = V D");
      check((eigen.values - theirs.eigenvalues()).norm() < 1e-11 * (1 + a.norm()),
            "symmetric values are Eigen's");
      check((eigen.values - symmetric_eigenvalues(a)).norm() < 1e-11 * (1 + a.norm()),
            "values alone are the same");
    }
}

void check_least_squares() {
  std::mt19937 random(3);
  for (int n = 1; n <= 8; ++n)
    for (int trial = 0; trial < 200; ++trial) {
      const SmallMatrix a = random_matrix(kMostSide, random).leftCols(n);
      const SmallVector b = random_matrix(kMostSide, random).col(0);
      const SmallVector x = least_squares(a, b);
      check((a.transpose() * (a * x - b)).norm() < 1e-11 * (1 + a.squaredNorm()),
            "least squares are at right angles");
    }
}

}  // namespace

int main() {
  check_general();
  check_symmetric();
  check_least_squares();
  return summary("decompositions");
}
