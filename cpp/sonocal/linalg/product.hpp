// Products of small matrices of fixed sizes.
#pragma once

#include <Eigen/Core>

namespace sonocal {

// Plain loops, which are as fast and compile in a fraction of the time that Eigen's take for each size.
template <int kRows, int kInner, int kColumns>
inline Eigen::Matrix<double, kRows, kColumns> product(const Eigen::Matrix<double, kRows, kInner>& a,
                                                      const Eigen::Matrix<double, kInner, kColumns>& b) {
  Eigen::Matrix<double, kRows, kColumns> out;
  const double *x = a.data(), *y = b.data();
  double* z = out.data();
  for (int c = 0; c < kColumns; ++c) {
    double sum[kRows] = {};
    for (int k = 0; k < kInner; ++k)
      for (int r = 0; r < kRows; ++r) sum[r] += x[r + kRows * k] * y[k + kInner * c];
    for (int r = 0; r < kRows; ++r) z[r + kRows * c] = sum[r];
  }
  return out;
}

// a' b
template <int kRows, int kInner, int kColumns>
inline Eigen::Matrix<double, kRows, kColumns> transposed_product(
    const Eigen::Matrix<double, kInner, kRows>& a, const Eigen::Matrix<double, kInner, kColumns>& b) {
  Eigen::Matrix<double, kRows, kColumns> out;
  const double *x = a.data(), *y = b.data();
  double* z = out.data();
  for (int c = 0; c < kColumns; ++c)
    for (int r = 0; r < kRows; ++r) {
      double sum = 0;
      for (int k = 0; k < kInner; ++k) sum += x[k + kInner * r] * y[k + kInner * c];
      z[r + kRows * c] = sum;
    }
  return out;
}

}  // namespace sonocal
