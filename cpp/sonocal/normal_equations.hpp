// The whole cost of point-to-line registration as one small quadratic form.
#pragma once

#include <Eigen/Core>

#include "sonocal/observations.hpp"

namespace sonocal {

enum class Model {
  kSimilarity = 7,   // rotation (3), translation (3), log scale
  kAnisotropic = 8,  // rotation (3), translation (3), log scale along u, along v
};

inline int parameter_count(Model model) { return static_cast<int>(model); }

using Tangent = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 8, 1>;
using TangentMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 8, 8>;

// (exp([w]x) R, t + v, s exp(l)) for the tangent (w, v, l).
Transform retract(const Transform& a, const Tangent& step);

// Every residual is linear in theta = (c1, c2, c3, t), the columns of S and the translation, so the
// sum of squares over any number of rows is
//
//     theta' H theta + 2 g' theta + c
//
// and an iteration over rotation, translation and scale costs the same for ten rows as for a million.
class NormalEquations {
 public:
  static constexpr int kLinear = 12;
  using Theta = Eigen::Matrix<double, kLinear, 1>;

  explicit NormalEquations(int dimension) : dimension_(dimension) {}

  // Adds the rows with squares[i] <= limit.
  void add_inliers(const PointLines& rows, const PointLines::Column& squares, double limit);

  int rows() const { return rows_; }
  double cost(const Transform& a) const;
  // J'J and J'r for the tangent at a, by the chain rule through theta.
  void linearise(const Transform& a, Model model, TangentMatrix& jtj, Tangent& jtr) const;

 private:
  int dimension_;
  int rows_ = 0;
  Eigen::Matrix<double, kLinear, kLinear> h_ = Eigen::Matrix<double, kLinear, kLinear>::Zero();
  Theta g_ = Theta::Zero();
  double c_ = 0;
};

}  // namespace sonocal
