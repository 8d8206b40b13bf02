#include "sonocal/correspondences/descent.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/ldlt.hpp"

namespace sonocal {
namespace {

using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

constexpr double kLeastDamping = 1e-12, kFirstDamping = 1e-3;
constexpr int kTrials = 4;
// Coordinates are of order one: a step below this moves nothing.
constexpr double kLeastStep = 1e-12;

Vector7d step_of(Matrix7d information, Vector7d gradient, double damping, bool scale_known) {
  information.diagonal().array() += damping * information.trace();
  if (scale_known) {
    information.row(6).setZero();
    information.col(6).setZero();
    information(6, 6) = 1;
    gradient[6] = 0;
  }
  return -Ldlt<7>(information).solve(gradient);
}

}  // namespace

void descend(const NormalEquations& cost, int steps, bool scale_known, Transform& a) {
  double best = cost.cost(a), damping = kLeastDamping;
  Matrix7d information;
  Vector7d gradient;
  for (int step = 0; step < steps; ++step) {
    cost.linearise<7>(a, information, gradient);
    bool better = false;
    for (int trial = 0; trial < kTrials && !better; ++trial) {
      const Vector7d tangent = step_of(information, gradient, damping, scale_known);
      const Transform next = retract<7>(a, tangent);
      const double next_cost = cost.cost(next);
      better = next_cost < best;
      damping = better ? std::max(kLeastDamping, damping * 1e-2) : std::max(kFirstDamping, damping * 10);
      if (!better) continue;
      a = next;
      best = next_cost;
      if (tangent.lpNorm<Eigen::Infinity>() < kLeastStep) return;
    }
    if (!better) return;
  }
}

}  // namespace sonocal
