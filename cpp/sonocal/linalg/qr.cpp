#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "sonocal/linalg/reflection.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

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
    for (int c = k + 1; c < a.cols(); ++c) apply_reflection(&a(k, k), tau[k], &a(k, c), rows - k);
  }
  Matrix q(rows, rows);
  q.setIdentity();
  for (int k = steps - 1; k >= 0; --k)
    for (int c = k; c < rows; ++c) apply_reflection(&a(k, k), tau[k], &q(k, c), rows - k);
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
    for (int c = rank + 1; c < columns; ++c) apply_reflection(&a(rank, rank), tau, &a(rank, c), rows - rank);
    apply_reflection(&a(rank, rank), tau, &b[rank], rows - rank);
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
