#include "sonocal/estimate/drift.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

constexpr int kMostColumns = 9;  // the tangent's and the residual's own
using FramePull = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMostColumns>;

// Fewer frames say nothing of how they repeat one another.
constexpr int kFewestTimes = 12;
// Standard deviations of chance below which neighbours' products are not looked at any closer.
constexpr double kScreened = 1.5;
// Twice the log likelihood that a drift must gain: three parameters gain as much by chance in one of 20
// scans.
constexpr double kLeastGain = 3.0;
// An offset for every frame is told from rows' own noise only where frames have more of them than one.
constexpr double kPairsEach = 1.5;
// An offset of a frame's own may take this much of what the weights give a frame.
constexpr double kMostTaken = 0.95;
// A memory of less than this many frames is hardly one.
constexpr double kLeastMemory = 0.7;
// The priors' standard deviation, of logarithms: without it, a flat likelihood would leave no freedom at all.
constexpr double kPriorWidth = 2.0;
constexpr double kLeastFreedomLeft = 4.5;
// Sums of squares below this part of what they are the difference of are none.
constexpr double kLostToRounding = 1e-10;

// What a frame's rows say of an offset of the line: B'B, and B'[J r].
struct FrameSums {
  double time;
  Matrix3d weight;
  FramePull pull;
};

enum Parameter { kWander, kMemory, kOwn, kParameters };
using Parameters = std::array<double, kParameters>;  // logarithms

class Frames {
 public:
  Frames(const WhiteResiduals& white, const double* time, const std::int32_t* targets) {
    const auto k = white.jacobian.cols();
    columns_ = static_cast<int>(k) + 1;
    const Eigen::VectorXd residual = without_targets(white, targets);
    std::vector<Eigen::Index> order(white.row.size());
    std::iota(order.begin(), order.end(), 0);
    const auto at = [&](Eigen::Index m) { return time[white.row[static_cast<std::size_t>(m)]]; };
    std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return at(a) < at(b); });
    for (const Eigen::Index m : order) {
      if (frames_.empty() || frames_.back().time != at(m))
        frames_.push_back({at(m), Matrix3d::Zero(), FramePull::Zero(3, columns_)});
      const Vector3d shift = white.shift.row(m).transpose();
      frames_.back().weight += shift * shift.transpose();
      frames_.back().pull.leftCols(k) += shift * white.jacobian.row(m);
      frames_.back().pull.col(k) += shift * residual[m];
    }
    whole_.setZero(columns_, columns_);
    whole_.topLeftCorner(k, k) = white.jacobian.transpose() * white.jacobian;
    whole_.col(k).head(k) = white.jacobian.transpose() * residual;
    whole_.row(k).head(k) = whole_.col(k).head(k).transpose();
    whole_(k, k) = residual.squaredNorm();
    freedom_ = static_cast<double>(residual.size() - k) - taken_;
  }

  int count() const { return static_cast<int>(frames_.size()); }
  double freedom() const { return freedom_; }
  double span() const { return frames_.back().time - frames_.front().time; }

  // By how many standard deviations of chance the products of frames' residuals, weighted by exp(-|time| /
  // memory), exceed what independent rows would give.
  double excess(double memory, const TangentMatrix& c) const {
    const double unit = whole_(columns_ - 1, columns_ - 1) / freedom_;
    FramePull before = FramePull::Zero(3, columns_);
    Matrix3d weight = Matrix3d::Zero();
    double sum = 0, spread = 0;
    for (int t = 1; t < count(); ++t) {
      const double keeps = kept(t, memory);
      before = keeps * (before + frames_[t - 1].pull);
      weight = keeps * keeps * (weight + frames_[t - 1].weight);
      const FramePull& now = frames_[t].pull;
      sum += now.col(columns_ - 1).dot(before.col(columns_ - 1)) / unit;
      const auto pulled = (now.leftCols(columns_ - 1) * c).eval();
      sum += pulled.cwiseProduct(before.leftCols(columns_ - 1)).sum();
      spread += weight.cwiseProduct(frames_[t].weight).sum();
    }
    return spread > 0 ? sum / std::sqrt(spread) : 0.0;
  }

  // Minus twice the log of the restricted likelihood, and s^2.
  struct Misfit {
    double value, unit;
  };
  Misfit misfit(double wander, double memory, double own) const {
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostColumns, kMostColumns> left = whole_;
    double determinants = 0;
    Matrix3d inverse;
    FramePull carried;
    double link = 0;
    for (int t = 0; t < count(); ++t) {
      Matrix3d weight = frames_[t].weight;
      FramePull pull = frames_[t].pull;
      if (own != 0) {
        const Matrix3d each = Matrix3d::Identity() + own * weight, shrink = each.inverse();
        determinants += std::log(each.determinant());
        left.noalias() -= own * pull.transpose() * (shrink * pull);
        weight = (shrink * weight).eval();
        pull = (shrink * pull).eval();
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
        const Eigen::LLT<Matrix3d> factor(posterior);
        determinants += 2 * factor.matrixLLT().diagonal().array().log().sum() + 3 * std::log(fresh);
        inverse = factor.solve(Matrix3d::Identity());
        carried = factor.solve(pull);
        left.noalias() -= pull.transpose() * carried;
        link = next / later;
      }
    }
    const Eigen::Index k = columns_ - 1;
    const SmallMatrix information = left.topLeftCorner(k, k);
    const SmallVector of = left.col(k).head(k);
    const Eigen::PartialPivLU<Eigen::MatrixXd> solver(information);
    const double squares = left(k, k) - of.dot(solver.solve(Eigen::VectorXd(of)));
    const double volume = std::log(std::abs(solver.determinant()));
    const double value = freedom_ * std::log(squares) + determinants + volume;
    // Rounding has eaten up what a huge drift leaves.
    const bool sound = squares > kLostToRounding * whole_(k, k) && std::isfinite(value);
    return {sound ? value : std::numeric_limits<double>::max(), squares / freedom_};
  }

  // C J'B K B'J C with K = wander exp(-|time| / memory), and `own` more of one frame with itself.
  TangentMatrix of_offsets(double wander, double memory, double own, const TangentMatrix& c) const {
    const Eigen::Index k = columns_ - 1;
    TangentMatrix sum = TangentMatrix::Zero(k, k);
    FramePull before = FramePull::Zero(3, columns_);
    for (int t = 0; t < count(); ++t) {
      const auto now = frames_[t].pull.leftCols(k);
      if (t > 0) before = (kept(t, memory) * (before + frames_[t - 1].pull)).eval();
      const TangentMatrix cross = now.transpose() * before.leftCols(k);
      sum += (wander + own) * (now.transpose() * now) + wander * (cross + cross.transpose());
    }
    return c * sum * c;
  }

  // Pairs of residuals a frame: more than one tell what a frame has of its own from what single rows have.
  double pairs_each() const { return (freedom_ + taken_ + columns_ - 1) / (2.0 * count()); }
  // The greatest part of its weight that an offset of a frame's own can take from the rows' noise: in a
  // volume, where levels that drift has blown up weigh a sighting's place too lightly, it is less than what
  // they say.
  double most_weight() const {
    double most = 0;
    for (const FrameSums& frame : frames_)
      most = std::max(most, symmetric_eigenvalues(frame.weight).maxCoeff());
    return most;
  }

 private:
  double kept(int t, double memory) const {
    return std::exp(-(frames_[t].time - frames_[t - 1].time) / memory);
  }

  // The residuals without an offset of each target's.
  Eigen::VectorXd without_targets(const WhiteResiduals& white, const std::int32_t* targets) {
    Eigen::VectorXd residual = white.residual;
    if (targets == nullptr) return residual;
    std::int32_t most = 0;
    for (const std::int32_t row : white.row) most = std::max(most, targets[row]);
    std::vector<Matrix3d> weight(most + 1, Matrix3d::Zero());
    std::vector<Vector3d> pull(most + 1, Vector3d::Zero());
    for (Eigen::Index m = 0; m < residual.size(); ++m) {
      const Vector3d shift = white.shift.row(m).transpose();
      weight[targets[white.row[m]]] += shift * shift.transpose();
      pull[targets[white.row[m]]] += shift * residual[m];
    }
    const auto used =
        std::count_if(weight.begin(), weight.end(), [](const Matrix3d& w) { return w.trace() > 0; });
    // One target's offset is part of the calibration; as many as rows would take up everything.
    if (used < 2 || 12 * used > residual.size()) return residual;
    taken_ = 3.0 * static_cast<double>(used);
    for (std::size_t g = 0; g < weight.size(); ++g) {
      // A shift along parallel lines is not seen: a trace of regularity keeps the inverse finite.
      weight[g] += (1e-9 * weight[g].trace() + 1e-300) * Matrix3d::Identity();
      pull[g] = (weight[g].inverse() * pull[g]).eval();
    }
    for (Eigen::Index m = 0; m < residual.size(); ++m)
      residual[m] -= white.shift.row(m).dot(pull[targets[white.row[m]]]);
    return residual;
  }

  std::vector<FrameSums> frames_;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostColumns, kMostColumns> whole_;
  int columns_ = 0;
  double freedom_ = 0, taken_ = 0;
};

// The likeliest parameters, by a search along the axes with ever smaller steps from the best of a grid.
class Search {
 public:
  explicit Search(const Frames& frames)
      : frames_(frames), most_memory_(std::log(std::max(2 * frames.span(), 4.0))) {
    own_ = frames.pairs_each() > kPairsEach;
    least_own_ = -kMostTaken / frames.most_weight();
  }

  // In units of the line's variance: one that a row's own noise alone would give.
  Parameters best(double row_variance) {
    Parameters at{};
    double least = std::numeric_limits<double>::max();
    for (double memory = std::log(1.5); memory < most_memory_; memory += std::log(3.0))
      for (const double share : {0.03, 0.3, 3.0})
        for (const double own : {0.0, 0.5}) {
          if (!own_ && own > 0) continue;
          const Parameters tried{std::log(share * row_variance), memory,
                                 std::log(own * row_variance - least_own_)};
          if (const double value = (*this)(tried); value < least) least = value, at = tried;
        }
    for (double step = 0.8; step > 0.02; step *= 0.5)
      for (bool better = true; better;) {
        better = false;
        for (int i = 0; i < (own_ ? 3 : 2); ++i)
          for (const double by : {-step, step}) {
            Parameters tried = at;
            tried[i] += by;
            if (const double value = (*this)(tried); value < least - 1e-6)
              least = value, at = tried, better = true;
          }
      }
    return at;
  }

  double operator()(const Parameters& p) const {
    if (p[kMemory] > most_memory_ || p[kMemory] < std::log(kLeastMemory) || std::abs(p[kWander]) > 40 ||
        p[kOwn] < -40)
      return std::numeric_limits<double>::max();
    return misfit(p).value;
  }
  Frames::Misfit misfit(const Parameters& p) const {
    return frames_.misfit(std::exp(p[kWander]), std::exp(p[kMemory]), own(p));
  }
  double own(const Parameters& p) const { return own_ ? least_own_ + std::exp(p[kOwn]) : 0.0; }
  double least_own() const { return least_own_; }
  bool has_own() const { return own_; }

 private:
  const Frames& frames_;
  double most_memory_, least_own_ = 0;
  bool own_;
};

// Errors' mean square in the tangent's own metric, relative to what rows' own noise alone would give.
double size_of(const Frames& frames, const Search& search, const Parameters& p, const TangentMatrix& c) {
  const TangentMatrix of = frames.of_offsets(std::exp(p[kWander]), std::exp(p[kMemory]), search.own(p), c);
  const TangentMatrix relative = c.inverse() * of;
  return search.misfit(p).unit * (1 + relative.trace() / static_cast<double>(c.rows()));
}

// Satterthwaite's freedom of the covariance, by the likelihood's curvature in wander and memory.
double freedom_of(const Frames& frames, const Search& search, const Parameters& at, const TangentMatrix& c) {
  constexpr double kStep = 0.25;
  const double here = search.misfit(at).value, size = size_of(frames, search, at, c);
  Eigen::Matrix2d curvature;
  Eigen::Vector2d slope;
  const auto moved = [&](double wander, double memory) {
    Parameters p = at;
    p[kWander] += wander, p[kMemory] += memory;
    return p;
  };
  const auto value = [&](double wander, double memory) { return search.misfit(moved(wander, memory)).value; };
  const auto log_size = [&](double wander, double memory) {
    return std::log(size_of(frames, search, moved(wander, memory), c) / size);
  };
  const double h = kStep;
  curvature(0, 0) = (value(h, 0) + value(-h, 0) - 2 * here) / (h * h);
  curvature(1, 1) = (value(0, h) + value(0, -h) - 2 * here) / (h * h);
  curvature(0, 1) = curvature(1, 0) =
      (value(h, h) + value(-h, -h) - value(h, -h) - value(-h, h)) / (4 * h * h);
  slope << (log_size(h, 0) - log_size(-h, 0)) / (2 * h), (log_size(0, h) - log_size(0, -h)) / (2 * h);
  curvature += 2 / (kPriorWidth * kPriorWidth) * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d inverse = curvature.inverse();
  double variance = 2 * slope.dot(inverse * slope);
  if (!(variance > 0) || curvature.determinant() <= 0) variance = 2 * slope.squaredNorm() * kPriorWidth;
  variance += 2 / frames.freedom();
  return std::max(2 / variance, kLeastFreedomLeft);
}

}  // namespace

Drift drift_of(const WhiteResiduals& white, const double* time, const std::int32_t* targets,
               const TangentMatrix& covariance) {
  Drift out;
  if (white.row.size() < 2 * kFewestTimes) return out;
  const Frames frames(white, time, targets);
  if (frames.count() < kFewestTimes || !(frames.freedom() > kLeastFreedomLeft)) return out;
  double excess = 0;
  for (double memory = 1.5; memory < frames.span(); memory *= 3)
    excess = std::max(excess, frames.excess(memory, covariance));
  if (!(excess > kScreened)) return out;

  Search search(frames);
  const double row_variance = static_cast<double>(white.shift.size()) / white.shift.squaredNorm() / 1.5;
  const Parameters best = search.best(row_variance);
  double without = frames.misfit(0, 1, 0).value;
  if (search.has_own())
    for (double own = -1e-2 * search.least_own(); own < row_variance * 1e3; own *= 1.5)
      without = std::min(without, frames.misfit(0, 1, own + search.least_own()).value);
  const Frames::Misfit misfit = search.misfit(best);
  if (!(without - misfit.value > kLeastGain)) return out;
  out.gain = without - misfit.value;
  out.unit = misfit.unit;
  out.wander = std::exp(best[kWander]);
  out.memory = std::exp(best[kMemory]);
  out.stretches = 1 + frames.span() / (2 * out.memory);
  out.freedom = freedom_of(frames, search, best, covariance);
  out.of_offsets = frames.of_offsets(out.wander, out.memory, search.own(best), covariance);
  return out;
}

}  // namespace sonocal
