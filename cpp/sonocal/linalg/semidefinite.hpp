// Small semidefinite feasibility: is there a positive member among matrices that are linear in a few numbers?
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {

// -log det of matrices K, and what is known of P = K^-1: its trace, and how that falls along each move.
template <int kMoves>
struct Barrier {
  Eigen::Matrix<double, kMoves, 1> gradient = Eigen::Matrix<double, kMoves, 1>::Zero();
  Eigen::Matrix<double, kMoves, kMoves> hessian = Eigen::Matrix<double, kMoves, kMoves>::Zero();
  Eigen::Matrix<double, kMoves, 1> trace_slope = Eigen::Matrix<double, kMoves, 1>::Zero();
  double trace = 0;
  int size = 0;
};

// start + sum_i x_i moves[i], all symmetric.
template <int kSize, int kMoves>
struct Pencil {
  using Square = Eigen::Matrix<double, kSize, kSize>;
  using Moves = std::array<Square, kMoves>;

  Square start;
  const Moves& moves;

  // Plain loops: Eigen unrolls expressions of fixed sizes, which takes seconds to compile.
  Square at(const Eigen::Matrix<double, kMoves, 1>& x, double lift = 0) const {
    Square sum = start;
    for (int i = 0; i < kMoves; ++i)
      for (int k = 0; k < kSize * kSize; ++k) sum.data()[k] += x[i] * moves[i].data()[k];
    for (int k = 0; k < kSize; ++k) sum(k, k) += lift;
    return sum;
  }
  double least(const Eigen::Matrix<double, kMoves, 1>& x) const {
    return symmetric_eigenvalues(SmallMatrix(at(x)))[0];
  }
  // Of at(x) + lift I; nothing is less where it is not positive.
  double log_determinant(const Eigen::Matrix<double, kMoves, 1>& x, double lift) const {
    const Ldlt<kSize> factors(at(x, lift));
    return factors.least_pivot() > 0 ? factors.log_determinant() : -std::numeric_limits<double>::infinity();
  }
  // Adds those of -log det(at(x) + lift I).
  void add_barrier(const Eigen::Matrix<double, kMoves, 1>& x, double lift, Barrier<kMoves>& to) const {
    Square one = Square::Zero();
    for (int k = 0; k < kSize; ++k) one(k, k) = 1;
    const Square inverse = Ldlt<kSize>(at(x, lift)).solve(one);
    const auto sum_of_products = [](const Square& a, const Square& b) {
      const double *x = a.data(), *y = b.data();
      double sum = 0;
#pragma omp simd reduction(+ : sum)
      for (int k = 0; k < kSize * kSize; ++k) sum += x[k] * y[k];
      return sum;
    };
    for (int k = 0; k < kSize; ++k) to.trace += inverse(k, k);
    to.size += kSize;
    Moves turned, transposed;
    for (int i = 0; i < kMoves; ++i) {
      turned[i] = product(inverse, moves[i]);
      for (int c = 0; c < kSize; ++c)
        for (int r = 0; r < kSize; ++r) transposed[i](r, c) = turned[i](c, r);
      for (int k = 0; k < kSize; ++k) to.gradient[i] -= turned[i](k, k);
      to.trace_slope[i] += sum_of_products(turned[i], inverse);
      for (int j = 0; j <= i; ++j) {
        const double sum = sum_of_products(turned[i], transposed[j]);
        to.hessian(i, j) += sum;
        if (j < i) to.hessian(j, i) += sum;
      }
    }
  }
};

// The greatest of all least eigenvalues of pencils that share their numbers, to within `tolerance`: found is
// the greatest that was reached, and it ends early where that is beyond the tolerance, or where none is above
// -tolerance. Negative and not `settled`: not found in the steps there are.
struct LeastEigenvalue {
  double found;
  bool settled;
};

// How far to go along a Newton step: the length at which convergence is proven, or as often twice of it as
// log det still grows, which takes a fraction of the time of a step and saves two of three.
template <int kMoves, class... Pencils>
double length_of_step(const Eigen::Matrix<double, kMoves, 1>& x,
                      const Eigen::Matrix<double, kMoves, 1>& newton, double decrement, double lift,
                      const Pencils&... pencils) {
  constexpr double kFullStep = 0.25, kLongest = 8;
  if (decrement < kFullStep) return 1;
  const auto at = [&](double length) { return (pencils.log_determinant(x + length * newton, lift) + ...); };
  double length = 1 / (1 + decrement), best = at(length);
  while (2 * length < kLongest) {
    const double further = at(2 * length);
    if (!(further > best)) break;
    best = further;
    length *= 2;
  }
  return length;
}

// Centres of -log det(K(x) + lift I), each from the last one with a smaller lift. Near one, P of K + lift I
// and the Newton step D of K give X = P - P D P >= 0, orthogonal to every move: no K has a least eigenvalue
// above <X, K> / tr X. Source: Boyd and Vandenberghe, Convex Optimization, 2004, 11.3 and 11.4 (phase I).
template <int kMoves, class... Pencils>
LeastEigenvalue greatest_least_eigenvalue(double tolerance, const Pencils&... pencils) {
  constexpr int kMostSteps = 80;
  constexpr double kCentred = 0.7, kPositive = 0.99, kShrink = 0.25, kWider = 1e-2;
  using Vector = Eigen::Matrix<double, kMoves, 1>;
  const auto least = [&](const Vector& x) { return std::min({pencils.least(x)...}); };
  Vector x = Vector::Zero();
  double reached = least(x), lift = std::max(-2 * reached, tolerance / kWider);
  for (int step = 0; step < kMostSteps && !(reached > tolerance); ++step) {
    Barrier<kMoves> barrier;
    (pencils.add_barrier(x, lift, barrier), ...);
    barrier.hessian.diagonal().array() += 1e-14 * barrier.hessian.trace();
    const Vector newton = -Ldlt<kMoves>(barrier.hessian).solve(barrier.gradient);
    const double square = std::max(-barrier.gradient.dot(newton), 0.0), decrement = std::sqrt(square);
    if (!std::isfinite(decrement)) break;
    const double trace = barrier.trace - barrier.trace_slope.dot(newton);
    if (decrement < kPositive && (barrier.size - square) / trace - lift < -tolerance) return {reached, true};
    x += length_of_step(x, newton, decrement, lift, pencils...) * newton;
    const bool positive = std::isfinite((pencils.log_determinant(x, -tolerance) + ...));
    if (positive) reached = least(x);
    if (reached > tolerance || decrement > kCentred) continue;
    reached = least(x);
    if (lift + reached < kWider * tolerance) return {reached, true};
    lift = kShrink * (lift + reached) - reached;
  }
  return {reached, reached > tolerance};
}

}  // namespace sonocal
