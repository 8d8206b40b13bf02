// The whole cost of point-to-line registration as one small quadratic form.
#pragma once

#include <Eigen/Core>

#include "sonocal/linalg/transform.hpp"

namespace sonocal {

enum class Model {
  kScaleKnown = 6,   // rotation (3), translation (3)
  kSimilarity = 7,   // rotation (3), translation (3), log scale
  kAnisotropic = 8,  // rotation (3), translation (3), log scale along u, along v
  kVoxels = 9,       // and along w: of a volume
};

inline int parameter_count(Model model) { return static_cast<int>(model); }

constexpr int kMostParameters = 9;
using TangentMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostParameters, kMostParameters>;
inline TangentMatrix times(const TangentMatrix& a, const TangentMatrix& b) { return a.lazyProduct(b); }

// (exp([w]x) R, t + v, s exp(l)) for the tangent (w, v, l).
template <int kParameters>
Transform retract(const Transform& a, const Eigen::Matrix<double, kParameters, 1>& step);

// The columns of R diag(scales) one under the other, and their derivative by (turn, log scales): a column c
// turns as w x c and grows as l c.
template <int kColumns>
using Columns = Eigen::Matrix<double, 3 * kColumns, 1>;
template <int kColumns>
Columns<kColumns> columns_of(const Transform& a) {
  Columns<kColumns> s;
  for (int column = 0; column < kColumns; ++column)
    s.template segment<3>(3 * column) = a.scales[column] * a.rotation.col(column);
  return s;
}
template <int kColumns, int kScales>
Eigen::Matrix<double, 3 * kColumns, 3 + kScales> columns_jacobian(const Columns<kColumns>& s) {
  Eigen::Matrix<double, 3 * kColumns, 3 + kScales> d =
      Eigen::Matrix<double, 3 * kColumns, 3 + kScales>::Zero();
  for (int column = 0; column < kColumns; ++column) {
    const Vector3d c = s.template segment<3>(3 * column);
    d.template block<3, 3>(3 * column, 0) = -cross_matrix(c);
    // Of two scales the second is the second column's; no point of a 2D image has a third coordinate.
    if (kScales == 1 || column < kScales)
      d.template block<3, 1>(3 * column, kScales == 1 ? 3 : 3 + column) = c;
  }
  return d;
}

// Up to 64 rows side by side, as structure of arrays. A row is a point x with its homogeneous coordinate
// h, and two planes with weights; its residuals are n_k . (S x + h t) + h o_k.
struct Block {
  static constexpr int kRows = 64;
  int count = 0;
  alignas(64) double x[3][kRows];
  alignas(64) double h[kRows];
  alignas(64) double normal[2][3][kRows];
  alignas(64) double offset[2][kRows];
  alignas(64) double weight[2][kRows];
};

// Every residual is linear in theta = (c1, c2, c3, t), the columns of S and the translation, so the
// weighted sum of squares over any number of rows is
//
//     theta' H theta + 2 g' theta + c
//
// and an iteration over rotation, translation and scale costs the same for ten rows as for a million.
class NormalEquations {
 public:
  static constexpr int kLinear = 12;
  using Theta = Eigen::Matrix<double, kLinear, 1>;
  using LinearMatrix = Eigen::Matrix<double, kLinear, kLinear>;

  // dimension 2: all points have x[2] = 0.
  explicit NormalEquations(int dimension) : dimension_(dimension) {}

  void add(const Block& block);
  // Twice a term linear in S x + h t of every row, and in the columns of S.
  void add_linear(const Block& block, const double (*pull)[Block::kRows], const Vector3d* columns);

  int rows() const { return rows_; }
  int dimension() const { return dimension_; }
  const LinearMatrix& h() const { return h_; }
  const Theta& g() const { return g_; }
  double c() const { return c_; }
  double cost(const Transform& a) const;
  // J'J and J'r for the tangent at a, by the chain rule through theta.
  template <int kParameters>
  void linearise(const Transform& a, Eigen::Matrix<double, kParameters, kParameters>& jtj,
                 Eigen::Matrix<double, kParameters, 1>& jtr) const;
  TangentMatrix information(const Transform& a, Model model) const;

 private:
  template <int kColumns, int kParameters>
  void linearise_columns(const Transform& a, Eigen::Matrix<double, kParameters, kParameters>& jtj,
                         Eigen::Matrix<double, kParameters, 1>& jtr) const;

  int dimension_;
  int rows_ = 0;
  LinearMatrix h_ = LinearMatrix::Zero();
  Theta g_ = Theta::Zero();
  double c_ = 0;
};

}  // namespace sonocal
