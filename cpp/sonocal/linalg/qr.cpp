#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

// H = 1 - tau v v' with v = (1, tail): carries x = (x_0, tail) to (beta, 0). The tail stays where x's was.
double reflect(double* x, int size) {
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
void apply(const double* v, double tau, double* x, int size) {
  double along = x[0];
  for (int i = 1; i < size; ++i) along += v[i] * x[i];
  along *= tau;
  x[0] -= along;
  for (int i = 1; i < size; ++i) x[i] -= along * v[i];
}

// The column from k on with the greatest norm below row k.
int greatest_column(const SmallMatrix& a, int k, double& squared_norm) {
  int best = k;
  squared_norm = -1;
  for (int c = k; c < a.cols(); ++c) {
    double sum = 0;
    for (int r = k; r < a.rows(); ++r) sum += a(r, c) * a(r, c);
    if (sum > squared_norm) squared_norm = sum, best = c;
  }
  return best;
}

}  // namespace

template <class Matrix>
Matrix orthogonal_factor(Matrix a) {
  const int rows = static_cast<int>(a.rows()), steps = static_cast<int>(std::min(a.rows(), a.cols()));
  double tau[kMostSide];
  for (int k = 0; k < steps; ++k) {
    tau[k] = reflect(&a(k, k), rows - k);
    for (int c = k + 1; c < a.cols(); ++c) apply(&a(k, k), tau[k], &a(k, c), rows - k);
  }
  Matrix q(rows, rows);
  q.setIdentity();
  for (int k = steps - 1; k >= 0; --k)
    for (int c = k; c < rows; ++c) apply(&a(k, k), tau[k], &q(k, c), rows - k);
  return q;
}
template SmallMatrix orthogonal_factor(SmallMatrix);
template Eigen::MatrixXd orthogonal_factor(Eigen::MatrixXd);

SmallVector least_squares(SmallMatrix a, SmallVector b) {
  const int rows = static_cast<int>(a.rows()), columns = static_cast<int>(a.cols());
  int order[kMostSide], rank = 0;
  double greatest = 0;
  for (int c = 0; c < columns; ++c) order[c] = c;
  for (; rank < std::min(rows, columns); ++rank) {
    double squared_norm;
    const int pivot = greatest_column(a, rank, squared_norm);
    if (rank == 0) greatest = squared_norm;
    constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
    if (squared_norm < greatest * kEpsilon * kEpsilon * (rows - rank) / rows || squared_norm == 0) break;
    std::swap(order[rank], order[pivot]);
    if (pivot != rank) std::swap_ranges(&a(0, rank), &a(0, rank) + rows, &a(0, pivot));
    const double tau = reflect(&a(rank, rank), rows - rank);
    for (int c = rank + 1; c < columns; ++c) apply(&a(rank, rank), tau, &a(rank, c), rows - rank);
    apply(&a(rank, rank), tau, &b[rank], rows - rank);
  }
  SmallVector x = SmallVector::Zero(columns);
  for (int k = rank - 1; k >= 0; --k) {
    double rest = b[k];
    for (int c = k + 1; c < rank; ++c) rest -= a(k, c) * x[order[c]];
    x[order[k]] = rest / a(k, k);
  }
  return x;
}

}  // namespace sonocal
