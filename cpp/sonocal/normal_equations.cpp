#include "sonocal/normal_equations.hpp"

#include <Eigen/Geometry>

namespace sonocal {
namespace {

using Theta = NormalEquations::Theta;
using ThetaJacobian =
    Eigen::Matrix<double, NormalEquations::kLinear, Eigen::Dynamic, 0, NormalEquations::kLinear, 8>;

Theta theta_of(const Transform& a) {
  Theta theta;
  Eigen::Map<Matrix3d>(theta.data()) = a.linear();
  theta.tail<3>() = a.translation;
  return theta;
}

// d theta / d (w, v, l): a column c of S turns as w x c and grows as l c; the translation shifts as v.
ThetaJacobian theta_jacobian(const Transform& a, Model model) {
  ThetaJacobian d = ThetaJacobian::Zero(NormalEquations::kLinear, parameter_count(model));
  const Matrix3d s = a.linear();
  for (int column = 0; column < 3; ++column) {
    d.block<3, 3>(3 * column, 0) = -cross_matrix(s.col(column));
    if (model == Model::kSimilarity || column < 2)
      d.block<3, 1>(3 * column, model == Model::kSimilarity ? 6 : 6 + column) = s.col(column);
  }
  d.block<3, 3>(9, 3).setIdentity();
  return d;
}

}  // namespace

Transform retract(const Transform& a, const Tangent& step) {
  Transform out = a;
  const double angle = step.head<3>().norm();
  if (angle > 0)
    out.rotation = Eigen::AngleAxisd(angle, step.head<3>() / angle).toRotationMatrix() * a.rotation;
  out.translation += step.segment<3>(3);
  if (step.size() == 7) {
    out.scales *= std::exp(step[6]);
  } else {
    out.scales[0] *= std::exp(step[6]);
    out.scales[1] *= std::exp(step[7]);
    // No point of a 2D image has a third coordinate: its scale is a convention, the mean.
    out.scales[2] = 0.5 * (out.scales[0] + out.scales[1]);
  }
  return out;
}

void NormalEquations::add_inliers(const PointLines& rows, const PointLines::Column& squares, double limit) {
  // With Q = n1 n1' + n2 n2' and b = n1 o1 + n2 o2 of a row and its homogeneous point (x, 1):
  //     H block (i, j) += x_i x_j Q,   g block i += x_i b,   c += o1^2 + o2^2.
  const int coordinates = dimension_ + 1;
  for (int row = 0; row < rows.size(); ++row) {
    if (!(squares[row] <= limit)) continue;
    ++rows_;
    Matrix3d q = Matrix3d::Zero();
    Vector3d b = Vector3d::Zero();
    for (int k = 0; k < PointLines::kPlanes; ++k) {
      const Vector3d n = rows.normals(k).row(row).matrix();
      const double offset = rows.offsets(k)[row];
      q.noalias() += n * n.transpose();
      b += offset * n;
      c_ += offset * offset;
    }
    const Vector3d x = rows.point(row);
    // Coordinates in the order of theta: u, v, (w,) then the homogeneous 1 at block 3.
    for (int i = 0; i < coordinates; ++i) {
      const int bi = i == dimension_ ? 3 : i;
      const double xi = i == dimension_ ? 1.0 : x[i];
      g_.segment<3>(3 * bi) += xi * b;
      for (int j = i; j < coordinates; ++j) {
        const int bj = j == dimension_ ? 3 : j;
        const double xj = j == dimension_ ? 1.0 : x[j];
        h_.block<3, 3>(3 * bi, 3 * bj).noalias() += (xi * xj) * q;
      }
    }
  }
}

double NormalEquations::cost(const Transform& a) const {
  const Theta theta = theta_of(a);
  return theta.dot(h_.selfadjointView<Eigen::Upper>() * theta + 2.0 * g_) + c_;
}

void NormalEquations::linearise(const Transform& a, Model model, TangentMatrix& jtj, Tangent& jtr) const {
  const ThetaJacobian d = theta_jacobian(a, model);
  const Theta gradient = h_.selfadjointView<Eigen::Upper>() * theta_of(a) + g_;
  jtr = d.transpose() * gradient;
  jtj = d.transpose() * (h_.selfadjointView<Eigen::Upper>() * d);
}

}  // namespace sonocal
