#include "sonocal/estimate/mixed_noise.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

// Squared standard deviations, a residual, beyond which a sighting counts less (Huber): 1 in 3000 of sound
// ones with one residual or two, fewer of more.
constexpr double kHuberOne = 13.0, kHuberEach = 8.0;

// Normals turned to where pixel noise is greatest and least, and what it is there.
struct Across {
  Vector3d normal[3];
  double alpha[3];
};
Across across(const Target& target, const Matrix3d& linear, int dimension) {
  Across out;
  const auto columns = linear.leftCols(dimension);
  SmallMatrix seen(target.normals, dimension);
  for (int k = 0; k < target.normals; ++k) seen.row(k) = target.normal[k].transpose() * columns;
  const SymmetricEigen eigen = symmetric_eigen(seen * seen.transpose());
  for (int k = 0; k < target.normals; ++k) {
    out.alpha[k] = std::max(eigen.values[k], 0.0);
    out.normal[k] = Vector3d::Zero();
    for (int i = 0; i < target.normals; ++i) out.normal[k] += eigen.vectors(i, k) * target.normal[i];
  }
  return out;
}

// Orthonormal combinations of m points in columns, and the target's noise that each sees: sum of squares of
// what it makes of the columns of `places`.
struct Along {
  Eigen::MatrixXd vectors;
  Eigen::VectorXd beta;
};
Along along(const Eigen::MatrixXd& places) {
  const Eigen::Index m = places.rows();
  if (m == 1) return {Eigen::MatrixXd::Ones(1, 1), Eigen::VectorXd::Constant(1, places.squaredNorm())};
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(places, Eigen::ComputeFullU);
  Along out{svd.matrixU(), Eigen::VectorXd::Zero(m)};
  out.beta.head(svd.singularValues().size()) = svd.singularValues().cwiseAbs2();
  return out;
}

}  // namespace

bool MixedBlocks::next(IndependentBlock& block) {
  block.count = block.residuals = 0;
  std::fill_n(block.column_pull, 3, Vector3d::Zero());
  while (block.count < Block::kRows) {
    if (waiting_.empty()) {
      if (next_ >= noise_.chosen_.size()) break;
      split(noise_.chosen_[next_]);
      next_ += step_;
    }
    put(waiting_.back(), block);
    waiting_.pop_back();
  }
  return block.count > 0;
}

void MixedBlocks::split(int sighting) {
  const MixedRows& rows = noise_.rows_;
  const Target& target = rows.target(sighting);
  const int m = rows.points(sighting), first = rows.first(sighting);
  const double fm = std::pow(rows.mm_factor(sighting), 2);
  Eigen::VectorXd factor(m);
  Eigen::MatrixXd places(m, 1 + target.reaches);
  for (int j = 0; j < m; ++j) {
    factor[j] = 1.0 / rows.px_factor(first + j);
    const Vector3d away = at_.apply(rows.point(first + j)) - target.middle;
    places(j, 0) = factor[j] * std::sqrt(target.shared);
    for (int k = 0; k < target.reaches; ++k) places(j, 1 + k) = factor[j] * target.reach[k].dot(away);
  }
  const Across normals = across(target, linear_, rows.dimension());
  const Along combined = along(places);
  const std::size_t begin = waiting_.size();
  double squared = 0;
  for (int j = 0; j < m; ++j) {
    const auto weights = combined.vectors.col(j);
    Row row;
    row.x.setZero();
    row.h = weights.dot(factor);
    for (int i = 0; i < m; ++i) row.x += weights[i] * factor[i] * rows.point(first + i);
    row.beta = fm * combined.beta[j];
    row.first_row = first;
    const Vector3d away = linear_ * row.x + row.h * (at_.translation - target.middle);
    // beta's derivative by the combined place: an eigenvalue moves as its matrix does between its vectors.
    Vector3d by_place = Vector3d::Zero();
    for (int k = 0; k < target.reaches; ++k)
      by_place += 2.0 * fm * weights.dot(places.col(1 + k)) * target.reach[k];
    const std::size_t of_this = waiting_.size();
    Vector3d strained = Vector3d::Zero();
    for (int taken = 0; taken < target.normals; taken += row.normals) {
      row.normals = std::min(target.normals - taken, 2);
      row.pull = row.strained = Vector3d::Zero();
      for (int k = 0; k < row.normals; ++k) {
        row.normal[k] = normals.normal[taken + k];
        row.offset[k] = -row.normal[k].dot(target.middle);
        row.alpha[k] = normals.alpha[taken + k];
        row.residual[k] = row.normal[k].dot(away);
        row.weight[k] = 1.0 / (levels_.px * row.alpha[k] + levels_.mm * row.beta);
        squared += row.residual[k] * row.residual[k] * row.weight[k];
        strained += row.residual[k] * row.weight[k] * row.normal[k];
      }
      waiting_.push_back(row);
    }
    waiting_[of_this].strained = strained;
    waiting_[of_this].pull = -0.5 * strained.squaredNorm() * levels_.mm * by_place;
  }
  const int residuals = m * target.normals;
  const double limit = residuals == 1 ? kHuberOne : kHuberEach * residuals;
  const double huber = std::sqrt(limit / std::max(squared, limit));
  for (std::size_t i = begin; i < waiting_.size(); ++i) waiting_[i].huber = huber;
}

void MixedBlocks::put(const Row& row, IndependentBlock& block) const {
  const int to = block.count++;
  block.residuals += row.normals;
  block.h[to] = row.h;
  block.huber[to] = row.huber;
  block.first_row[to] = row.first_row;
  for (int axis = 0; axis < 3; ++axis) {
    block.x[axis][to] = row.x[axis];
    block.pull[axis][to] = row.huber * row.pull[axis];
  }
  for (int k = 0; k < 2; ++k) {
    const bool there = k < row.normals;  // a second plane that is not has no weight
    for (int axis = 0; axis < 3; ++axis) block.normal[k][axis][to] = there ? row.normal[k][axis] : 0.0;
    block.offset[k][to] = there ? row.offset[k] : 0.0;
    block.residual[k][to] = there ? row.residual[k] : 0.0;
    block.alpha[k][to] = there ? row.alpha[k] : 0.0;
    block.beta[k][to] = there ? row.beta : 0.0;
    block.weight[k][to] = there ? row.weight[k] : 0.0;
  }
  // Half the derivative of r' V^-1 r through the pixel noise N' S S' N, by a column s of S: -(z . s) z.
  for (int column = 0; column < noise_.dimension(); ++column)
    block.column_pull[column] -=
        row.huber * levels_.px * row.strained.dot(linear_.col(column)) * row.strained;
}

}  // namespace sonocal
