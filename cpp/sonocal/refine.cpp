#include "sonocal/refine.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

namespace sonocal {

namespace {

constexpr double kFirstDamping = 1e-4;
constexpr double kSmallestDamping = 1e-12;
constexpr double kLargestDamping = 1e12;
// Parameters are of order one (normalised coordinates): a step below this moves nothing.
constexpr double kConvergedStep = 1e-11;

template <int kParameters>
Refinement descend(const NormalEquations& equations, const Transform& start, int max_iterations) {
  Refinement result{start, equations.cost(start), 0, false};
  Eigen::Matrix<double, kParameters, kParameters> jtj, damped;
  Eigen::Matrix<double, kParameters, 1> jtr, step;
  double damping = kFirstDamping;
  // The quadratic form is exact to about its rounding error, not to zero; differences below it are noise.
  const double rounding = 64 * std::numeric_limits<double>::epsilon() * (equations.rows() + 1);
  while (result.iterations < max_iterations && !result.converged) {
    ++result.iterations;
    equations.linearise<kParameters>(result.transform, jtj, jtr);
    while (true) {
      damped = jtj;
      damped.diagonal() *= 1.0 + damping;
      step = -damped.ldlt().solve(jtr);
      const Transform next = retract<kParameters>(result.transform, step);
      const double cost = equations.cost(next);
      if (cost <= result.cost + rounding) {
        result.transform = next;
        result.cost = cost;
        result.converged = step.template lpNorm<Eigen::Infinity>() < kConvergedStep;
        damping = std::fmax(damping * 0.1, kSmallestDamping);
        break;
      }
      damping *= 10.0;
      if (damping > kLargestDamping || !step.allFinite()) return result;
    }
  }
  return result;
}

}  // namespace

bool ran_away(const Transform& a, const Transform& start) {
  const Vector3d change = a.scales.cwiseQuotient(start.scales);
  return !(change.minCoeff() > 1e-3 && change.maxCoeff() < 1e3 && a.translation.allFinite());
}

Refinement refine(const NormalEquations& equations, const Transform& start, Model model, int max_iterations) {
  return model == Model::kSimilarity ? descend<7>(equations, start, max_iterations)
                                     : descend<8>(equations, start, max_iterations);
}

}  // namespace sonocal
