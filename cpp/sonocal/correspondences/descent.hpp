// Least squares over any number of rows, from a given start.
#pragma once

#include "sonocal/solvers/normal_equations.hpp"

namespace sonocal {

// Up to `steps` damped Gauss-Newton steps, each of which lowers the cost; they cost the same for ten rows as
// for a million. With the scale known it stays what it is.
void descend(const NormalEquations& cost, int steps, bool scale_known, Transform& a);

}  // namespace sonocal
