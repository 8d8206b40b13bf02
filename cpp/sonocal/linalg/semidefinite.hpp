// Small semidefinite feasibility: is there a positive member among matrices that are linear in a few numbers?
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {

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
  // Adds the gradient and the Hessian of -log det(at(x) + lift I).
  void add_barrier(const Eigen::Matrix<double, kMoves, 1>& x, double lift,
                   Eigen::Matrix<double, kMoves, 1>& gradient,
                   Eigen::Matrix<double, kMoves, kMoves>& hessian) const {
    Square one = Square::Zero();
    for (int k = 0; k < kSize; ++k) one(k, k) = 1;
    const Square inverse = Ldlt<kSize>(at(x, lift)).solve(one);
    Moves turned;
    for (int i = 0; i < kMoves; ++i) {
      turned[i] = product(inverse, moves[i]);
      for (int k = 0; k < kSize; ++k) gradient[i] -= turned[i](k, k);
      for (int j = 0; j <= i; ++j) {
        double sum = 0;
        for (int c = 0; c < kSize; ++c)
          for (int r = 0; r < kSize; ++r) sum += turned[i](r, c) * turned[j](c, r);
        hessian(i, j) += sum;
        if (j < i) hessian(j, i) += sum;
      }
    }
  }
};

// The greatest of all least eigenvalues of pencils that share their numbers, to within `tolerance`: found is
// the greatest that was reached, and it ends early beyond the tolerance. Negative and not `settled`: not
// found in the steps there are.
struct LeastEigenvalue {
  double found;
  bool settled;
};

// Centres of -log det(K(x) + lift I), each from the last one with a smaller lift. Source: Boyd and
// Vandenberghe, Convex Optimization, 2004, 11.3 and 11.4 (phase I).
template <int kMoves, class... Pencils>
LeastEigenvalue greatest_least_eigenvalue(double tolerance, const Pencils&... pencils) {
  constexpr int kMostSteps = 80;
  constexpr double kCentred = 0.7, kFullStep = 0.25, kShrink = 0.25, kWider = 1e-2;
  using Vector = Eigen::Matrix<double, kMoves, 1>;
  using Square = Eigen::Matrix<double, kMoves, kMoves>;
  const auto least = [&](const Vector& x) { return std::min({pencils.least(x)...}); };
  Vector x = Vector::Zero();
  double reached = least(x), lift = std::max(-2 * reached, tolerance / kWider);
  for (int step = 0; step < kMostSteps && !(reached > tolerance); ++step) {
    Vector gradient = Vector::Zero();
    Square hessian = Square::Zero();
    (pencils.add_barrier(x, lift, gradient, hessian), ...);
    hessian.diagonal().array() += 1e-14 * hessian.trace();
    const Vector newton = -Ldlt<kMoves>(hessian).solve(gradient);
    const double decrement = std::sqrt(std::max(-gradient.dot(newton), 0.0));
    if (!std::isfinite(decrement)) break;
    x += newton / (decrement < kFullStep ? 1.0 : 1.0 + decrement);
    if (decrement > kCentred) continue;
    reached = least(x);
    if (lift + reached < kWider * tolerance) return {reached, true};
    lift = kShrink * (lift + reached) - reached;
  }
  return {reached, reached > tolerance};
}

}  // namespace sonocal
