#include "sonocal/linalg/ldlt.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace sonocal {

template <int kSize>
void Ldlt<kSize>::factorise(const double* a) {
  for (int i = 0; i < kSize; ++i)
    for (int j = 0; j <= i; ++j) l_[i][j] = a[i + kSize * j];
  for (int k = 0; k < kSize; ++k) {
    int pivot = k;
    for (int i = k + 1; i < kSize; ++i)
      if (std::fabs(l_[i][i]) > std::fabs(l_[pivot][pivot])) pivot = i;
    order_[k] = pivot;
    if (pivot != k) {
      std::swap(l_[k][k], l_[pivot][pivot]);
      std::swap_ranges(l_[k], l_[k] + k, l_[pivot]);
      for (int i = k + 1; i < pivot; ++i) std::swap(l_[i][k], l_[pivot][i]);
      for (int i = pivot + 1; i < kSize; ++i) std::swap(l_[i][k], l_[i][pivot]);
    }
    const double inverse = l_[k][k] == 0 ? 0.0 : 1.0 / l_[k][k];
    for (int i = k + 1; i < kSize; ++i) {
      const double factor = l_[i][k] * inverse;
      for (int j = k + 1; j <= i; ++j) l_[i][j] -= factor * l_[j][k];
    }
    for (int i = k + 1; i < kSize; ++i) l_[i][k] *= inverse;
  }
  least_ = greatest_ = l_[0][0];
  for (int k = 1; k < kSize; ++k) {
    least_ = std::min(least_, l_[k][k]);
    greatest_ = std::max(greatest_, l_[k][k]);
  }
}

template <int kSize>
void Ldlt<kSize>::solve_column(double* b) const {
  for (int k = 0; k < kSize; ++k) std::swap(b[k], b[order_[k]]);
  for (int i = 1; i < kSize; ++i)
    for (int j = 0; j < i; ++j) b[i] -= l_[i][j] * b[j];
  for (int i = 0; i < kSize; ++i)
    b[i] = std::fabs(l_[i][i]) > std::numeric_limits<double>::min() ? b[i] / l_[i][i] : 0.0;
  for (int i = kSize - 1; i >= 0; --i)
    for (int j = i + 1; j < kSize; ++j) b[i] -= l_[j][i] * b[j];
  for (int k = kSize - 1; k >= 0; --k) std::swap(b[k], b[order_[k]]);
}

template class Ldlt<2>;
template class Ldlt<3>;
template class Ldlt<4>;
template class Ldlt<5>;
template class Ldlt<6>;
template class Ldlt<7>;
template class Ldlt<8>;
template class Ldlt<9>;
template class Ldlt<10>;
template class Ldlt<14>;
template class Ldlt<20>;

}  // namespace sonocal
