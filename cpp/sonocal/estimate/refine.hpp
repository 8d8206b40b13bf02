// Levenberg-Marquardt over rotation and scale, the translation following in closed form.
#pragma once

#include "sonocal/solvers/normal_equations.hpp"

namespace sonocal {

// Enough for whatever converges at all.
constexpr int kFinalIterations = 60;

struct Refinement {
  Transform transform;
  double cost = 0;  // sum of squared distances
  int iterations = 0;
  bool converged = false;
};

// Whether a refinement ran away: rows that belong to no one calibration are nearest to their lines when the
// image shrinks to a point.
bool ran_away(const Transform& a, const Transform& start);

// min over R, t, s of sum_i d(L_i, A x_i)^2: paper section 8.
Refinement refine(const NormalEquations& equations, const Transform& start, Model model, int max_iterations);

}  // namespace sonocal
