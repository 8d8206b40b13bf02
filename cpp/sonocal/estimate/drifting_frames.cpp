#include "sonocal/estimate/drifting_frames.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Sums of squares below this part of what they are the difference of are none.
constexpr double kLostToRounding = 1e-10;

// What a turn by a radian or a scale e times as large costs, in units of what all residuals sum to. Weights
// do not move with the transform here: an image that shrinks to a point, its needles' ways taken for drift,
// would explain everything.
constexpr double kStiffness = 4;

// What the first k columns leave of the sum of squares of the next one, and the log of their determinant:
// L D L' of the leading part of a symmetric matrix, in place.
struct Left {
  double squares, log_determinant = 0;
};
template <class Square>
Left left_of(Square& a, int k) {
  Left out;
  for (int j = 0; j < k; ++j) {
    out.log_determinant += std::log(std::abs(a(j, j)));
    for (int i = j + 1; i <= k; ++i) {
      const double factor = a(i, j) / a(j, j);
      for (int m = j + 1; m <= i; ++m) a(i, m) -= factor * a(m, j);
    }
  }
  out.squares = a(k, k);
  return out;
}

// sum += by a'b, in the lower triangle or whole.
template <int kColumns>
void add_product(Eigen::Matrix<double, kColumns, kColumns>& sum, double by,
                 const Eigen::Matrix<double, 3, kColumns>& a, const Eigen::Matrix<double, 3, kColumns>& b) {
  const double *x = a.data(), *y = b.data();
  double* z = sum.data();
  for (int c = 0; c < kColumns; ++c)
    for (int r = 0; r < kColumns; ++r)
      z[r + kColumns * c] +=
          by * (x[3 * r] * y[3 * c] + x[3 * r + 1] * y[3 * c + 1] + x[3 * r + 2] * y[3 * c + 2]);
}

double dot_of(const double* a, const double* b, int count) {
  double sum = 0;
  for (int i = 0; i < count; ++i) sum += a[i] * b[i];
  return sum;
}

void add_scaled(double* sum, double by, const double* a, int count) {
  for (int i = 0; i < count; ++i) sum[i] += by * a[i];
}

template <class Square>
Square padded(const TangentMatrix& a) {
  Square out = Square::Zero();
  for (Eigen::Index c = 0; c < a.cols(); ++c)
    for (Eigen::Index r = 0; r < a.rows(); ++r) out(r, c) = a(r, c);
  return out;
}

// [J r] of one residual.
template <int kColumns>
std::array<double, kColumns> row_of(const WhiteResiduals& white, const Eigen::VectorXd& residual,
                                    Eigen::Index m) {
  std::array<double, kColumns> row{};
  const auto k = white.jacobian.cols();
  std::copy_n(white.jacobian.data() + m * k, k, row.begin());
  row[static_cast<std::size_t>(k)] = residual[m];
  return row;
}

}  // namespace

template <int kColumns>
DriftingFrames<kColumns>::DriftingFrames(const WhiteResiduals& white, const double* time,
                                         const std::int32_t* targets)
    : whole_(Square::Zero()), parameters_(static_cast<int>(white.jacobian.cols())) {
  const Eigen::VectorXd residual = without_targets(white, targets);
  std::vector<Eigen::Index> order(white.row.size());
  std::iota(order.begin(), order.end(), 0);
  const auto at = [&](Eigen::Index m) { return time[white.row[static_cast<std::size_t>(m)]]; };
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return at(a) < at(b); });
  for (const Eigen::Index m : order) {
    if (frames_.empty() || frames_.back().time != at(m))
      frames_.push_back({at(m), Matrix3d::Zero(), Pull::Zero()});
    Frame& frame = frames_.back();
    const auto row = row_of<kColumns>(white, residual, m);
    const double* shift = white.shift.data() + 3 * m;
    for (int i = 0; i < 3; ++i) add_scaled(frame.weight.data() + 3 * i, shift[i], shift, 3);
    for (int c = 0; c < kColumns; ++c) {
      add_scaled(frame.pull.data() + 3 * c, row[c], shift, 3);
      add_scaled(whole_.data() + kColumns * c, row[c], row.data(), kColumns);
    }
  }
  freedom_ = static_cast<double>(residual.size() - parameters_) - taken_;
  for (int i = 0; i < parameters_; ++i)
    if (i < 3 || i >= 6) whole_(i, i) += kStiffness * freedom_;
}

template <int kColumns>
double DriftingFrames<kColumns>::excess(double memory, const TangentMatrix& covariance) const {
  const Square c = padded<Square>(covariance);
  const double unit = whole_(parameters_, parameters_) / freedom_;
  Pull before = Pull::Zero();
  Matrix3d weight = Matrix3d::Zero();
  double sum = 0, spread = 0;
  for (int t = 1; t < count(); ++t) {
    const double keeps = kept(t, memory);
    before = keeps * (before + frames_[t - 1].pull);
    weight = keeps * keeps * (weight + frames_[t - 1].weight);
    const Pull& now = frames_[t].pull;
    sum += dot_of(now.data() + 3 * parameters_, before.data() + 3 * parameters_, 3) / unit;
    const Pull taken = product(now, c);
    sum += dot_of(taken.data(), before.data(), 3 * kColumns);
    spread += dot_of(weight.data(), frames_[t].weight.data(), 9);
  }
  return spread > 0 ? sum / std::sqrt(spread) : 0.0;
}

template <int kColumns>
typename DriftingFrames<kColumns>::Misfit DriftingFrames<kColumns>::misfit(double wander, double memory,
                                                                           double own) const {
  Square left = whole_;
  double determinants = 0;
  Matrix3d inverse;
  Pull carried;
  double link = 0;
  for (int t = 0; t < count(); ++t) {
    Matrix3d weight = frames_[t].weight;
    Pull pull = frames_[t].pull;
    if (own != 0) {
      const Ldlt<3> each(Matrix3d::Identity() + own * weight);
      determinants += each.log_determinant();
      const Pull shrunk = each.solve(pull);
      add_product(left, -own, pull, shrunk);
      weight = each.solve(weight);
      pull = shrunk;
    }
    if (wander > 0) {
      const double keeps = t > 0 ? kept(t, memory) : 0.0;
      const double next = t + 1 < count() ? kept(t + 1, memory) : 0.0;
      const double fresh = wander * -std::expm1(2 * std::log(std::max(keeps, 1e-300)));
      const double later = wander * (1 - next * next);
      Matrix3d posterior = weight + (1 / fresh + next * next / later) * Matrix3d::Identity();
      if (t > 0) {
        posterior -= link * link * inverse;
        pull += link * carried;
      }
      // What lies along a line is known from the prior alone: an inverse by cofactors would lose the rest
      // in it.
      const Ldlt<3> factor(posterior);
      determinants += factor.log_determinant() + 3 * std::log(fresh);
      inverse = factor.solve(Matrix3d(Matrix3d::Identity()));
      carried = factor.solve(pull);
      add_product(left, -1.0, pull, carried);
      link = next / later;
    }
  }
  const auto [squares, volume] = left_of(left, parameters_);
  const double value = freedom_ * std::log(squares) + determinants + volume;
  // Rounding has eaten up what a huge drift leaves.
  const bool sound = squares > kLostToRounding * whole_(parameters_, parameters_) && std::isfinite(value);
  return {sound ? value : std::numeric_limits<double>::max(), squares / freedom_};
}

template <int kColumns>
TangentMatrix DriftingFrames<kColumns>::pulled(double wander, double memory, double own) const {
  Square sum = Square::Zero(), cross = Square::Zero();
  Pull before = Pull::Zero();
  for (int t = 0; t < count(); ++t) {
    const Pull& now = frames_[t].pull;
    if (t > 0) before = kept(t, memory) * (before + frames_[t - 1].pull);
    add_product(sum, wander + own, now, now);
    add_product(cross, wander, now, before);
  }
  TangentMatrix out(parameters_, parameters_);
  for (int c = 0; c < parameters_; ++c)
    for (int r = 0; r < parameters_; ++r) out(r, c) = sum(r, c) + cross(r, c) + cross(c, r);
  return out;
}

template <int kColumns>
double DriftingFrames<kColumns>::most_weight() const {
  double most = 0;
  for (const Frame& frame : frames_) most = std::max(most, symmetric_eigenvalues(frame.weight).maxCoeff());
  return most;
}

template <int kColumns>
double DriftingFrames<kColumns>::kept(int t, double memory) const {
  return std::exp(-(frames_[t].time - frames_[t - 1].time) / memory);
}

// The residuals without an offset of each target's.
template <int kColumns>
Eigen::VectorXd DriftingFrames<kColumns>::without_targets(const WhiteResiduals& white,
                                                          const std::int32_t* targets) {
  Eigen::VectorXd residual = white.residual;
  if (targets == nullptr) return residual;
  std::int32_t most = 0;
  for (const std::int32_t row : white.row) most = std::max(most, targets[row]);
  std::vector<Matrix3d> weight(most + 1, Matrix3d::Zero());
  std::vector<Vector3d> pull(most + 1, Vector3d::Zero());
  const auto target = [&](Eigen::Index m) { return targets[white.row[static_cast<std::size_t>(m)]]; };
  const auto shift = [&](Eigen::Index m) { return white.shift.data() + 3 * m; };
  for (Eigen::Index m = 0; m < residual.size(); ++m) {
    for (int i = 0; i < 3; ++i) add_scaled(weight[target(m)].data() + 3 * i, shift(m)[i], shift(m), 3);
    add_scaled(pull[target(m)].data(), residual[m], shift(m), 3);
  }
  const auto used =
      std::count_if(weight.begin(), weight.end(), [](const Matrix3d& w) { return w.trace() > 0; });
  // One target's offset is part of the calibration; as many as rows would take up everything.
  if (used < 2 || 12 * used > residual.size()) return residual;
  taken_ = 3.0 * static_cast<double>(used);
  for (std::size_t g = 0; g < weight.size(); ++g) {
    // A shift along parallel lines is not seen: a trace of regularity keeps the inverse finite.
    weight[g] += (1e-9 * weight[g].trace() + 1e-300) * Matrix3d::Identity();
    pull[g] = Ldlt<3>(weight[g]).solve<1>(pull[g]);
  }
  for (Eigen::Index m = 0; m < residual.size(); ++m)
    residual[m] -= dot_of(shift(m), pull[target(m)].data(), 3);
  return residual;
}

template class DriftingFrames<9>;
template class DriftingFrames<kMostParameters + 1>;

}  // namespace sonocal
