#include "sonocal/solvers/normal_equations.hpp"

#include <cmath>
#include <type_traits>

#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/vectors.hpp"

namespace sonocal {
namespace {

using Theta = NormalEquations::Theta;
using LinearMatrix = NormalEquations::LinearMatrix;

Theta theta_of(const Transform& a) {
  Theta theta;
  Eigen::Map<Matrix3d>(theta.data()) = a.linear();
  theta.tail<3>() = a.translation;
  return theta;
}

// What the planes of a block give: the upper triangle of Q = sum_p weight_p n_p n_p', and b.
struct Products {
  alignas(64) double q[6][Block::kRows];  // Q: xx xy xz yy yz zz
  alignas(64) double b[3][Block::kRows];  // h sum_p weight_p o_p n_p
};

SONOCAL_WIDEST_VECTORS void multiply_planes(const Block& block, Products& out, double& c) {
  const auto &n = block.normal[0], &m = block.normal[1];
  double constant = 0;
#pragma omp simd reduction(+ : constant)
  for (int i = 0; i < block.count; ++i) {
    const double v = block.weight[0][i], w = block.weight[1][i];
    const double nx = v * n[0][i], ny = v * n[1][i], nz = v * n[2][i];
    const double mx = w * m[0][i], my = w * m[1][i], mz = w * m[2][i];
    out.q[0][i] = nx * n[0][i] + mx * m[0][i];
    out.q[1][i] = nx * n[1][i] + mx * m[1][i];
    out.q[2][i] = nx * n[2][i] + mx * m[2][i];
    out.q[3][i] = ny * n[1][i] + my * m[1][i];
    out.q[4][i] = ny * n[2][i] + my * m[2][i];
    out.q[5][i] = nz * n[2][i] + mz * m[2][i];
    const double o = block.h[i] * block.offset[0][i], p = block.h[i] * block.offset[1][i];
    out.b[0][i] = nx * o + mx * p;
    out.b[1][i] = ny * o + my * p;
    out.b[2][i] = nz * o + mz * p;
    constant += v * o * o + w * p * p;
  }
  c += constant;
}

SONOCAL_WIDEST_VECTORS void sum_products(const double* x, const double* y, const Products& p, int count,
                                         double* out) {
  double s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0;
#pragma omp simd reduction(+ : s0, s1, s2, s3, s4, s5)
  for (int i = 0; i < count; ++i) {
    const double w = x[i] * y[i];
    s0 += w * p.q[0][i];
    s1 += w * p.q[1][i];
    s2 += w * p.q[2][i];
    s3 += w * p.q[3][i];
    s4 += w * p.q[4][i];
    s5 += w * p.q[5][i];
  }
  out[0] = s0, out[1] = s1, out[2] = s2, out[3] = s3, out[4] = s4, out[5] = s5;
}

SONOCAL_WIDEST_VECTORS void sum_offsets(const double* x, const double (*b)[Block::kRows], int count,
                                        double* out) {
  double s0 = 0, s1 = 0, s2 = 0;
#pragma omp simd reduction(+ : s0, s1, s2)
  for (int i = 0; i < count; ++i) {
    s0 += x[i] * b[0][i];
    s1 += x[i] * b[1][i];
    s2 += x[i] * b[2][i];
  }
  out[0] = s0, out[1] = s1, out[2] = s2;
}

}  // namespace

template <int kParameters>
Transform retract(const Transform& a, const Eigen::Matrix<double, kParameters, 1>& step) {
  Transform out = a;
  const Vector3d w = step.template head<3>();
  out.rotation = product(rotation_by(w), a.rotation);
  out.translation += step.template segment<3>(3);
  if constexpr (kParameters == 7) {
    out.scales *= std::exp(step[6]);
  } else if constexpr (kParameters == 8) {
    out.scales[0] *= std::exp(step[6]);
    out.scales[1] *= std::exp(step[kParameters - 1]);
    // No point of a 2D image has a third coordinate: its scale is a convention, the mean.
    out.scales[2] = 0.5 * (out.scales[0] + out.scales[1]);
  } else if constexpr (kParameters == 9) {
    for (int axis = 0; axis < 3; ++axis) out.scales[axis] *= std::exp(step[kParameters - 3 + axis]);
  }
  return out;
}
template Transform retract<6>(const Transform&, const Eigen::Matrix<double, 6, 1>&);
template Transform retract<7>(const Transform&, const Eigen::Matrix<double, 7, 1>&);
template Transform retract<8>(const Transform&, const Eigen::Matrix<double, 8, 1>&);
template Transform retract<9>(const Transform&, const Eigen::Matrix<double, 9, 1>&);

void NormalEquations::add(const Block& block) {
  // H block (i, j) += x_i x_j Q and g block i += x_i b, the homogeneous coordinate h being block 3.
  Products products;
  multiply_planes(block, products, c_);
  rows_ += block.count;
  const double* x[4] = {block.x[0], block.x[1], block.x[2], block.h};
  double q[6], b[3];
  for (int i = 0; i < 4; ++i) {
    if (i == 2 && dimension_ == 2) continue;
    sum_offsets(x[i], products.b, block.count, b);
    g_.segment<3>(3 * i) += Vector3d(b[0], b[1], b[2]);
    for (int j = i; j < 4; ++j) {
      if (j == 2 && dimension_ == 2) continue;
      sum_products(x[i], x[j], products, block.count, q);
      Matrix3d sum;
      sum << q[0], q[1], q[2], q[1], q[3], q[4], q[2], q[4], q[5];
      h_.block<3, 3>(3 * i, 3 * j) += sum;
      if (i != j) h_.block<3, 3>(3 * j, 3 * i) += sum;
    }
  }
}

void NormalEquations::add_linear(const Block& block, const double (*pull)[Block::kRows],
                                 const Vector3d* columns) {
  const double* x[4] = {block.x[0], block.x[1], block.x[2], block.h};
  for (int i = 0; i < 4; ++i) {
    if (i == 2 && dimension_ == 2) continue;
    double sum[3];
    sum_offsets(x[i], pull, block.count, sum);
    g_.segment<3>(3 * i) += Vector3d(sum[0], sum[1], sum[2]);
    if (i < 3) g_.segment<3>(3 * i) += columns[i];
  }
}

double NormalEquations::cost(const Transform& a) const {
  const Theta theta = theta_of(a);
  return theta.dot(product(h_, theta) + 2.0 * g_) + c_;
}

template <int kColumns, int kParameters>
void NormalEquations::linearise_columns(const Transform& a,
                                        Eigen::Matrix<double, kParameters, kParameters>& jtj,
                                        Eigen::Matrix<double, kParameters, 1>& jtr) const {
  constexpr int kSize = 3 * kColumns, kScales = kParameters - 6;
  const Columns<kColumns> s = columns_of<kColumns>(a);
  const auto d = columns_jacobian<kColumns, kScales>(s);
  const Eigen::Matrix<double, kSize, kSize> h_ss = h_.template topLeftCorner<kSize, kSize>();
  const Eigen::Matrix<double, 3, kSize> h_ts = h_.template block<3, kSize>(9, 0);
  const Matrix3d h_tt = h_.template bottomRightCorner<3, 3>();
  const Eigen::Matrix<double, 3 + kScales, 3 + kScales> turning = transposed_product(d, product(h_ss, d));
  const Eigen::Matrix<double, 3, 3 + kScales> mixed = product(h_ts, d);
  const Columns<kColumns> by_columns =
      product(h_ss, s) + transposed_product(h_ts, a.translation) + g_.template head<kSize>();
  const Eigen::Matrix<double, 3 + kScales, 1> gradient = transposed_product(d, by_columns);
  // The tangent's order: turn, translation, log scales.
  jtj.template topLeftCorner<3, 3>() = turning.template topLeftCorner<3, 3>();
  jtj.template block<3, 3>(3, 0) = mixed.template leftCols<3>();
  jtj.template block<3, 3>(3, 3) = h_tt;
  jtj.template block<kScales, 3>(6, 0) = turning.template bottomLeftCorner<kScales, 3>();
  jtj.template block<kScales, 3>(6, 3) = mixed.template rightCols<kScales>().transpose();
  jtj.template block<kScales, kScales>(6, 6) = turning.template bottomRightCorner<kScales, kScales>();
  for (int row = 0; row < kParameters; ++row)
    for (int column = row + 1; column < kParameters; ++column) jtj(row, column) = jtj(column, row);
  jtr.template head<3>() = gradient.template head<3>();
  jtr.template segment<3>(3) = product(h_ts, s) + product(h_tt, a.translation) + g_.template tail<3>();
  jtr.template tail<kScales>() = gradient.template tail<kScales>();
}

template <int kParameters>
void NormalEquations::linearise(const Transform& a, Eigen::Matrix<double, kParameters, kParameters>& jtj,
                                Eigen::Matrix<double, kParameters, 1>& jtr) const {
  if (dimension_ == 2)
    linearise_columns<2>(a, jtj, jtr);
  else
    linearise_columns<3>(a, jtj, jtr);
}
template void NormalEquations::linearise<6>(const Transform&, Eigen::Matrix<double, 6, 6>&,
                                            Eigen::Matrix<double, 6, 1>&) const;
template void NormalEquations::linearise<7>(const Transform&, Eigen::Matrix<double, 7, 7>&,
                                            Eigen::Matrix<double, 7, 1>&) const;
template void NormalEquations::linearise<8>(const Transform&, Eigen::Matrix<double, 8, 8>&,
                                            Eigen::Matrix<double, 8, 1>&) const;
template void NormalEquations::linearise<9>(const Transform&, Eigen::Matrix<double, 9, 9>&,
                                            Eigen::Matrix<double, 9, 1>&) const;

TangentMatrix NormalEquations::information(const Transform& a, Model model) const {
  const auto jtj = [&](auto parameters) -> TangentMatrix {
    constexpr int k = decltype(parameters)::value;
    Eigen::Matrix<double, k, k> matrix;
    Eigen::Matrix<double, k, 1> unused;
    linearise<k>(a, matrix, unused);
    return matrix;
  };
  switch (model) {
    case Model::kScaleKnown:
      return jtj(std::integral_constant<int, 6>());
    case Model::kSimilarity:
      return jtj(std::integral_constant<int, 7>());
    case Model::kAnisotropic:
      return jtj(std::integral_constant<int, 8>());
    default:
      return jtj(std::integral_constant<int, 9>());
  }
}

}  // namespace sonocal
