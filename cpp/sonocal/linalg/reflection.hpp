// Householder's reflections of vectors in place.
#pragma once

#include <cmath>
#include <limits>

namespace sonocal {

// H = 1 - tau v v' with v = (1, tail): carries x = (x_0, tail) to (beta, 0). The tail stays where x's was.
inline double reflect(double* x, int size) {
  double tail = 0;
  for (int i = 1; i < size; ++i) tail += x[i] * x[i];
  if (tail <= std::numeric_limits<double>::min()) return 0;
  const double length = std::sqrt(x[0] * x[0] + tail), beta = x[0] >= 0 ? -length : length;
  const double tau = (beta - x[0]) / beta, inverse = 1.0 / (x[0] - beta);
  for (int i = 1; i < size; ++i) x[i] *= inverse;
  x[0] = beta;
  return tau;
}

// x becomes H x.
inline void apply_reflection(const double* v, double tau, double* x, int size) {
  double along = x[0];
  for (int i = 1; i < size; ++i) along += v[i] * x[i];
  along *= tau;
  x[0] -= along;
  for (int i = 1; i < size; ++i) x[i] -= along * v[i];
}

}  // namespace sonocal
