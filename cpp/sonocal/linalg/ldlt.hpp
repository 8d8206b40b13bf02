// L D L' decomposition of small symmetric matrices.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace sonocal {

// P' L D L' P with the greatest pivot first, of the lower triangle. Sizes from 2 to 8, 10 and 14, compiled
// once in ldlt.cpp from plain loops: Eigen's, of a fixed size, takes seconds wherever it is used.
template <int kSize>
class Ldlt {
 public:
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;

  explicit Ldlt(const Matrix& a) { factorise(a.data()); }

  // A^-1 b for every column of b; a pivot that vanishes gives nothing.
  template <int kColumns>
  Eigen::Matrix<double, kSize, kColumns> solve(Eigen::Matrix<double, kSize, kColumns> b) const {
    for (int column = 0; column < kColumns; ++column) solve_column(b.data() + kSize * column);
    return b;
  }
  double least_pivot() const { return least_; }
  double greatest_pivot() const { return greatest_; }
  // Of a positive definite matrix.
  double log_determinant() const {
    double sum = 0;
    for (int k = 0; k < kSize; ++k) sum += std::log(l_[k][k]);
    return sum;
  }

 private:
  void factorise(const double* a);
  void solve_column(double* b) const;

  double l_[kSize][kSize];  // below the diagonal; the pivots on it
  int order_[kSize];
  double least_, greatest_;
};

extern template class Ldlt<2>;
extern template class Ldlt<3>;
extern template class Ldlt<4>;
extern template class Ldlt<5>;
extern template class Ldlt<6>;
extern template class Ldlt<7>;
extern template class Ldlt<8>;
extern template class Ldlt<9>;
extern template class Ldlt<10>;
extern template class Ldlt<14>;
extern template class Ldlt<20>;

}  // namespace sonocal
