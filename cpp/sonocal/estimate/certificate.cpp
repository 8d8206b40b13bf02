#include "sonocal/estimate/certificate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "sonocal/estimate/likelihood.hpp"
#include "sonocal/estimate/mixed_estimate.hpp"
#include "sonocal/estimate/quaternion_minors.hpp"
#include "sonocal/estimate/rotation_scale_cost.hpp"
#include "sonocal/linalg/semidefinite.hpp"
#include "sonocal/solvers/three_quadrics.hpp"

// With fixed weights the cost is quadratic in the columns of S = s R; that they are those of a similarity are
// quadratic equations. Multipliers of these for which the Lagrangian is a convex quadratic form with its
// least value at an answer prove that none is better: a semidefinite relaxation, known to be tight for such
// problems. Source: Briales and Gonzalez-Jimenez, Convex global 3D registration with Lagrangian duality, CVPR
// 2017, here with the scale among the unknowns.
//
// The frame is turned and scaled so that S is the identity at the answer. G, half the cost's derivatives by
// the columns, is symmetric then and has no trace, since neither a turn nor a growth is a slope. Where the
// scale is known a growth may be: the columns' lengths have multipliers of their own.

namespace sonocal {
namespace {

// Of the form's trace: eigenvalues up to this are zero, and slopes up to that.
constexpr double kZero = 1e-12, kLevel = 1e-9;
// An answer that refinement moves further than this was none.
constexpr double kMoved = 1e-5;

bool several_scales(Model model) { return model == Model::kAnisotropic || model == Model::kVoxels; }

Certificate judged(const LeastEigenvalue& least, double zero) {
  if (least.found > zero) return Certificate::kOptimal;
  return least.settled && least.found > -zero ? Certificate::kTied : Certificate::kNotShown;
}

// Where the slope vanishes: the cost in the answer's frame.
template <int kColumns>
struct AtAnswer {
  using Square = Eigen::Matrix<double, 3 * kColumns, 3 * kColumns>;
  Square form;
  Eigen::Matrix<double, kColumns, kColumns> slope;  // G, its first rows
  double unrest;  // of the turns and growths that the model has, the slope that is left

  AtAnswer(const NormalEquations& equations, const Transform& at, Model model, bool scale_known) {
    const RotationScaleCost<kColumns> cost(equations, at.translation);
    const auto gradient = cost.gradient(columns_of<kColumns>(at));
    Eigen::Matrix<double, 3, kColumns> all;
    for (int j = 0; j < kColumns; ++j) {
      const Matrix3d turned = at.scales[j] * at.rotation;
      all.col(j) = turned.transpose() * gradient.template segment<3>(3 * j);
      for (int i = 0; i < kColumns; ++i) {
        const Matrix3d block = cost.curvature().template block<3, 3>(3 * i, 3 * j);
        form.template block<3, 3>(3 * i, 3 * j) = at.scales[i] * at.rotation.transpose() * block * turned;
      }
    }
    slope = all.template topRows<kColumns>();
    unrest = (slope - slope.transpose()).cwiseAbs().maxCoeff();
    if (kColumns == 2) unrest = std::max(unrest, all.row(2).cwiseAbs().maxCoeff());
    if (several_scales(model))
      unrest = std::max(unrest, slope.diagonal().cwiseAbs().maxCoeff());
    else if (!scale_known)
      unrest = std::max(unrest, std::fabs(slope.trace()));
    slope = 0.5 * (slope + slope.transpose()).eval();
  }

  bool at_rest() const { return unrest <= kLevel * form.trace(); }

  // The form less the multipliers (kColumns x kColumns) of the columns' lengths and angles.
  Square less(const Eigen::Matrix<double, kColumns, kColumns>& multipliers) const {
    Square out = form;
    for (int i = 0; i < kColumns; ++i)
      for (int j = 0; j < kColumns; ++j)
        out.template block<3, 3>(3 * i, 3 * j).diagonal().array() -= multipliers(i, j);
    return out;
  }
};

bool near(const Transform& a, const Transform& b) {
  return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff() < kMoved;
}

double least_of(const SmallMatrix& form) { return symmetric_eigenvalues(form)[0]; }

// A 2D image says nothing of the third column, so that (c1, c2, -c3, -s) costs the same and solves the same
// equations: the multipliers' part by (c3, s) stands apart. It is positive where a symmetric M is, which S S'
// = s^2 I (by -M), c1 x c2 = s c3 (by -2 M e3) and the lengths of c1 and c2 are then taken by; of (c1, c2):
//
//     [ M - (m11 + m33) I      -[M e3]x - m12 I ]
//     [  [M e3]x - m12 I      M - (m22 + m33) I ]
Pencil<6, 6>::Moves moves_of_two_columns() {
  Pencil<6, 6>::Moves out;
  for (int i = 0; i < 6; ++i) {
    const Matrix3d m = symmetric_unit(i), one = Matrix3d::Identity();
    const Matrix3d across = -cross_matrix(m.col(2)) - m(0, 1) * one;
    out[i] << m - (m(0, 0) + m(2, 2)) * one, across, across.transpose(), m - (m(1, 1) + m(2, 2)) * one;
  }
  return out;
}

Pencil<3, 6>::Moves moves_of_third_column() {
  Pencil<3, 6>::Moves out;
  for (int i = 0; i < 6; ++i) out[i] = symmetric_unit(i);
  return out;
}

Certificate of_two_columns(const NormalEquations& equations, const Transform& at, Model model,
                           bool scale_known) {
  const AtAnswer<2> answer(equations, at, model, scale_known);
  if (!answer.at_rest()) return Certificate::kNotShown;
  const double zero = kZero * answer.form.trace();
  Eigen::Matrix2d multipliers = answer.slope;
  if (several_scales(model)) multipliers.diagonal().setZero();
  const Pencil<6, 6>::Square plain = answer.less(multipliers);
  const double least = least_of(SmallMatrix(plain));
  if (least > zero) return Certificate::kOptimal;
  // Of two scales only the angle between the columns is asked for.
  if (several_scales(model)) return judged({least, true}, zero);
  if (scale_known) {
    AtAnswer<3>::Square with_third = AtAnswer<3>::Square::Zero();
    with_third.topLeftCorner<6, 6>() = plain;
    return judged(least_of_rotations(with_third, zero), zero);
  }
  static const Pencil<6, 6>::Moves by_columns = moves_of_two_columns();
  static const Pencil<3, 6>::Moves by_third = moves_of_third_column();
  const Pencil<6, 6> columns{plain, by_columns};
  const Pencil<3, 6> third{Matrix3d::Zero(), by_third};
  return judged(greatest_least_eigenvalue<6>(zero, columns, third), zero);
}

Certificate of_three_columns(const NormalEquations& equations, const Transform& at, Model model,
                             bool scale_known) {
  const AtAnswer<3> answer(equations, at, model, scale_known);
  if (!answer.at_rest()) return Certificate::kNotShown;
  const double zero = kZero * answer.form.trace();
  Matrix3d multipliers = answer.slope;
  if (several_scales(model)) multipliers.diagonal().setZero();
  const AtAnswer<3>::Square plain = answer.less(multipliers);
  const double least = least_of(SmallMatrix(plain));
  if (least > zero) return Certificate::kOptimal;
  if (several_scales(model)) return judged({least, true}, zero);
  return judged(scale_known ? least_of_rotations(plain, zero) : least_of_similarities(plain, zero), zero);
}

// Coordinates of order one: x = (point - from) / from_size, y likewise.
struct Frames {
  Vector3d from = Vector3d::Zero(), to = Vector3d::Zero();
  double from_size = 0, to_size = 0;

  Transform normalised(const Transform& a) const {
    return {a.rotation, (a.apply(from) - to) / to_size, a.scales * (from_size / to_size)};
  }
};

std::vector<PointOnPlane> chosen_rows(const Correspondences& all, const bool* chosen, const double* weights,
                                      std::vector<double>& of_rows) {
  std::vector<PointOnPlane> rows;
  for (int c = 0; c < all.count; ++c)
    for (int i = all.first[c]; chosen[c] && i < all.first[c + 1]; ++i) {
      rows.push_back(read_row(all.points, all.planes, i));
      of_rows.push_back(weights ? weights[c] * weights[c] : 1.0);
    }
  return rows;
}

// The transform's own image of the points says how large the target is, planes through the origin or not.
Frames frames_of(const std::vector<PointOnPlane>& rows, const Transform& at) {
  Frames out;
  for (const PointOnPlane& row : rows) out.from += row.point / static_cast<double>(rows.size());
  for (const PointOnPlane& row : rows) out.from_size = std::max(out.from_size, (row.point - out.from).norm());
  out.to = at.apply(out.from);
  out.to_size = at.scales[0] * out.from_size;
  return out;
}

NormalEquations equations_of(const std::vector<PointOnPlane>& rows, const std::vector<double>& weights,
                             const Frames& frames) {
  const bool flat = std::all_of(rows.begin(), rows.end(), [](const auto& row) { return row.point[2] == 0; });
  NormalEquations out(flat ? 2 : 3);
  Block block{};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const int at = block.count++;
    const Vector3d x = (rows[i].point - frames.from) / frames.from_size;
    for (int k = 0; k < 3; ++k) {
      block.x[k][at] = x[k];
      block.normal[0][k][at] = block.normal[1][k][at] = rows[i].normal[k];
    }
    block.h[at] = 1;
    block.offset[0][at] = block.offset[1][at] =
        (rows[i].offset + rows[i].normal.dot(frames.to)) / frames.to_size;
    block.weight[0][at] = weights[i];
    block.weight[1][at] = 0;
    if (block.count == Block::kRows || i + 1 == rows.size()) {
      out.add(block);
      block.count = 0;
    }
  }
  return out;
}

}  // namespace

Certificate certificate(const NormalEquations& equations, const Transform& at, Model model) {
  const bool scale_known = model == Model::kScaleKnown;
  return equations.dimension() == 2 ? of_two_columns(equations, at, model, scale_known)
                                    : of_three_columns(equations, at, model, scale_known);
}

Certificate certificate(const Table& table, const bool* chosen, const Transform& at, const Options& options) {
  const PointLines rows(table.points, table.segments, table.rows, table.dimension);
  PointLines::Column selector(table.rows);
  for (int i = 0; i < table.rows; ++i) selector[i] = chosen[i] ? 0.0 : 1.0;
  constexpr double kChosen = 0.5;
  const Transform start = rows.normalisation().to_normalised(at);
  const NormalEquations equations =
      options.weighting == Weighting::kGeometric
          ? rows.geometric_cost(selector, kChosen)
          : weighted_cost(NoiseModel(rows, sightings_of(table), table.noise, selector, kChosen), start,
                          options.levels);
  const Refinement refined = refine(equations, start, options.model, kFinalIterations);
  if (!near(refined.transform, start)) return Certificate::kNotShown;
  return certificate(equations, refined.transform, options.model);
}

Certificate certificate(const MixedTable& table, const bool* chosen, const Transform& at,
                        const Options& options) {
  const MixedRows rows(table);
  const Transform start = rows.normalisation().to_normalised(at);
  const NormalEquations equations = mixed_cost(rows, chosen, start, options.levels);
  const Refinement refined = refine(equations, start, options.model, kFinalIterations);
  if (!near(refined.transform, start)) return Certificate::kNotShown;
  return certificate(equations, refined.transform, options.model);
}

Certificate certificate(const Correspondences& all, const bool* chosen, const double* weights,
                        double fixed_scale, const Transform& at) {
  std::vector<double> of_rows;
  const std::vector<PointOnPlane> rows = chosen_rows(all, chosen, weights, of_rows);
  const Frames frames = frames_of(rows, at);
  if (rows.empty() || !(frames.to_size > 0)) return Certificate::kNotShown;
  const NormalEquations equations = equations_of(rows, of_rows, frames);
  const Transform start = frames.normalised(at);
  if (fixed_scale > 0) return certificate(equations, start, Model::kScaleKnown);
  const Refinement refined = refine(equations, start, Model::kSimilarity, kFinalIterations);
  if (!near(refined.transform, start)) return Certificate::kNotShown;
  return certificate(equations, refined.transform, Model::kSimilarity);
}

}  // namespace sonocal
