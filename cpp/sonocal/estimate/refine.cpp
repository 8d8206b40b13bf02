#include "sonocal/estimate/refine.hpp"

#include <cmath>
#include <limits>

#include "sonocal/estimate/rotation_scale_cost.hpp"

namespace sonocal {

namespace {

constexpr double kFirstDamping = 1e-4;
constexpr double kSmallestDamping = 1e-12;
constexpr double kLargestDamping = 1e12;
// Parameters are of order one (normalised coordinates): a step below this moves nothing.
constexpr double kConvergedStep = 1e-11;

template <int kColumns, int kScales>
Refinement descend(const NormalEquations& equations, const Transform& start, int max_iterations) {
  constexpr int kParameters = 3 + kScales;
  const RotationScaleCost<kColumns> cost(equations, start.translation);
  auto columns = columns_of<kColumns>(start);
  Refinement result{start, cost.at(columns), 0, false};
  Eigen::Matrix<double, kParameters, kParameters> jtj, newton, damped;
  Eigen::Matrix<double, kParameters, 1> jtr, step;
  Eigen::Matrix<double, 6 + kScales, 1> tangent = Eigen::Matrix<double, 6 + kScales, 1>::Zero();
  double damping = kFirstDamping;
  // The quadratic form is exact to about its rounding error, not to zero; differences below it are noise.
  const double rounding = 64 * std::numeric_limits<double>::epsilon() * (equations.rows() + 1);
  bool stuck = false;
  while (result.iterations < max_iterations && !result.converged && !stuck) {
    ++result.iterations;
    cost.template linearise<kScales>(columns, jtj, jtr, newton);
    while (true) {
      // Of large residuals J'J leaves out what bends the cost, and comes to rest slowly or not at all. Where
      // the cost is bent downwards it is what still leads down.
      damped = newton;
      damped.diagonal() *= 1.0 + damping;
      const Ldlt<kParameters> bent(damped);
      if (bent.least_pivot() > 0) {
        step = -bent.solve(jtr);
      } else {
        damped = jtj;
        damped.diagonal() *= 1.0 + damping;
        step = -Ldlt<kParameters>(damped).solve(jtr);
      }
      tangent.template head<3>() = step.template head<3>();
      tangent.template tail<kScales>() = step.template tail<kScales>();
      const Transform next = retract<6 + kScales>(result.transform, tangent);
      const auto next_columns = columns_of<kColumns>(next);
      const double next_cost = cost.at(next_columns);
      if (next_cost <= result.cost + rounding) {
        result.transform = next;
        result.cost = next_cost;
        columns = next_columns;
        result.converged = step.template lpNorm<Eigen::Infinity>() < kConvergedStep;
        damping = std::fmax(damping * 0.1, kSmallestDamping);
        break;
      }
      damping *= 10.0;
      stuck = damping > kLargestDamping || !step.allFinite();
      if (stuck) break;
    }
  }
  result.transform.translation = cost.translation(columns);
  return result;
}

template <int kColumns>
Refinement descend_as(const NormalEquations& equations, const Transform& start, Model model,
                      int max_iterations) {
  switch (model) {
    case Model::kScaleKnown:
      return descend<kColumns, 0>(equations, start, max_iterations);
    case Model::kSimilarity:
      return descend<kColumns, 1>(equations, start, max_iterations);
    case Model::kAnisotropic:
      return descend<kColumns, 2>(equations, start, max_iterations);
    default:
      return descend<kColumns, kColumns>(equations, start, max_iterations);
  }
}

}  // namespace

bool ran_away(const Transform& a, const Transform& start) {
  const Vector3d change = a.scales.cwiseQuotient(start.scales);
  return !(change.minCoeff() > 1e-3 && change.maxCoeff() < 1e3 && a.translation.allFinite());
}

Refinement refine(const NormalEquations& equations, const Transform& start, Model model, int max_iterations) {
  return (equations.dimension() == 2 ? descend_as<2> : descend_as<3>)(equations, start, model,
                                                                      max_iterations);
}

}  // namespace sonocal
