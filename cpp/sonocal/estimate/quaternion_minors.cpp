#include "sonocal/estimate/quaternion_minors.hpp"

#include <algorithm>
#include <utility>

namespace sonocal {
namespace {

constexpr int kUnsloped = 14, kSloped = 6, kAll = kUnsloped + kSloped;
using Similarities = Pencil<10, kAll>;
using Slopes = Pencil<3, kAll>;
using Rotations = Pencil<9, kUnsloped>;

// Four times an entry of W as a form of (c1, c2, c3, s).
using Form = Eigen::Matrix<double, 10, 1>;
Form quaternion_entry(int i, int j) {
  Form out = Form::Zero();
  const auto add = [&](int row, int column, double by) { out[3 * column + row] += by; };
  if (i > j) std::swap(i, j);
  if (i == j) {
    out[9] = 1;
    for (int k = 0; k < 3; ++k) add(k, k, i == 0 || k == i - 1 ? 1 : -1);
  } else if (i == 0) {
    add((j + 1) % 3, j % 3, 1);  // S21 - S12 and so on round
    add(j % 3, (j + 1) % 3, -1);
  } else {
    add(i - 1, j - 1, 1);
    add(j - 1, i - 1, 1);
  }
  return out;
}

// W_ik W_jl - W_il W_jk as a quadratic form of them.
Similarities::Square minor_of(int i, int j, int k, int l) {
  const Form w = quaternion_entry(i, k), x = quaternion_entry(j, l), y = quaternion_entry(i, l),
             z = quaternion_entry(j, k);
  Similarities::Square out;
  for (int r = 0; r < 10; ++r)
    for (int c = 0; c < 10; ++c) out(c, r) = 0.25 * (w[c] * x[r] + x[c] * w[r] - y[c] * z[r] - z[c] * y[r]);
  return out;
}

// Those without a slope at the answer, then those with that of W_11, W_22, W_33, 2 W_12, 2 W_13, 2 W_23. The
// three of two rows and the two others add up to nothing, so that one is left out.
Similarities::Moves all_minors() {
  constexpr int kFirst[] = {0, 0, 0, 1, 1, 2}, kSecond[] = {1, 2, 3, 2, 3, 3};
  Similarities::Moves out;
  int count = 0;
  for (int a = 0; a < 6; ++a)
    for (int b = std::max(a, 3); b < 6; ++b)
      if (a != 2 || b != 3) out[count++] = minor_of(kFirst[a], kSecond[a], kFirst[b], kSecond[b]);
  for (int i = 0; i < 3; ++i) out[count++] = minor_of(0, i + 1, 0, i + 1);
  for (const auto& [i, j] : {std::pair{1, 2}, std::pair{1, 3}, std::pair{2, 3}})
    out[count++] = 2.0 * minor_of(0, i, 0, j);
  return out;
}

Slopes::Moves all_slopes() {
  Slopes::Moves out;
  for (int i = 0; i < kUnsloped; ++i) out[i] = Matrix3d::Zero();
  for (int i = 0; i < kSloped; ++i) out[kUnsloped + i] = symmetric_unit(i);
  return out;
}

Rotations::Moves of_columns(const Similarities::Moves& all) {
  Rotations::Moves out;
  for (int i = 0; i < kUnsloped; ++i) out[i] = all[i].topLeftCorner<9, 9>();
  return out;
}

const Similarities::Moves& minors() {
  static const Similarities::Moves moves = all_minors();
  return moves;
}

}  // namespace

LeastEigenvalue least_of_similarities(const Eigen::Matrix<double, 9, 9>& plain, double tolerance) {
  static const Slopes::Moves slopes = all_slopes();
  Similarities of_columns{Similarities::Square::Zero(), minors()};
  of_columns.start.topLeftCorner<9, 9>() = plain;
  return greatest_least_eigenvalue<kAll>(tolerance, of_columns, Slopes{Matrix3d::Zero(), slopes});
}

LeastEigenvalue least_of_rotations(const Eigen::Matrix<double, 9, 9>& plain, double tolerance) {
  static const Rotations::Moves moves = of_columns(minors());
  return greatest_least_eigenvalue<kUnsloped>(tolerance, Rotations{plain, moves});
}

}  // namespace sonocal
