#include "sonocal/estimate/drift.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "sonocal/estimate/drifting_frames.hpp"

namespace sonocal {
namespace {

// Fewer frames say nothing of how they repeat one another.
constexpr int kFewestTimes = 12;
// Standard deviations of chance below which neighbours' products are not looked at any closer.
constexpr double kScreened = 1.5;
// Twice the log likelihood that a drift must gain: by chance some sound scans of a thousand do. With one in
// twenty, those few made what is predicted of all sound scans a quarter too large, in the mean square.
constexpr double kLeastGain = 10.0;
// An offset for every frame is told from rows' own noise only where frames have more of them than one.
constexpr double kPairsEach = 1.5;
// An offset of a frame's own may take this much of what the weights give a frame.
constexpr double kMostTaken = 0.95;
// A memory of less than this many frames is hardly one.
constexpr double kLeastMemory = 0.7;
// Of rows' own variance: a drift of a thousand times their noise is none, and beyond it rounding takes over.
constexpr double kMostWander = 1e6;
// The priors' standard deviation, of logarithms: without it, a flat likelihood would leave no freedom at all.
constexpr double kPriorWidth = 2.0;
constexpr double kLeastFreedomLeft = 4.5;

enum Parameter { kWander, kMemory, kOwn, kParameters };
using Parameters = std::array<double, kParameters>;  // logarithms

// The likeliest parameters, by a search along the axes with ever smaller steps from the best of a grid.
template <class Frames>
class DriftSearch {
 public:
  // row_variance: in units of the line's variance, one that a row's own noise alone would give.
  DriftSearch(const Frames& frames, double row_variance)
      : frames_(frames),
        row_variance_(row_variance),
        most_memory_(std::log(std::max(2 * frames.span(), 4.0))),
        most_wander_(std::log(kMostWander * row_variance)) {
    own_ = frames.pairs_each() > kPairsEach;
    least_own_ = -kMostTaken / frames.most_weight();
  }

  Parameters best() {
    Parameters at{};
    double least = std::numeric_limits<double>::max();
    for (double memory = std::log(1.5); memory < most_memory_; memory += std::log(3.0))
      for (const double share : {0.03, 0.3, 3.0})
        for (const double own : {0.0, 0.5}) {
          if (!own_ && own > 0) continue;
          const Parameters tried{std::log(share * row_variance_), memory,
                                 std::log(own * row_variance_ - least_own_)};
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
    if (p[kMemory] > most_memory_ || p[kMemory] < std::log(kLeastMemory) || p[kWander] > most_wander_ ||
        p[kWander] < -40 || p[kOwn] < -40)
      return std::numeric_limits<double>::max();
    return misfit(p).value;
  }
  typename Frames::Misfit misfit(const Parameters& p) const {
    return frames_.misfit(std::exp(p[kWander]), std::exp(p[kMemory]), own(p));
  }
  double own(const Parameters& p) const { return own_ ? least_own_ + std::exp(p[kOwn]) : 0.0; }
  double least_own() const { return least_own_; }
  bool has_own() const { return own_; }

 private:
  const Frames& frames_;
  double row_variance_, most_memory_, most_wander_, least_own_ = 0;
  bool own_;
};

template <class Frames>
TangentMatrix of_offsets(const Frames& frames, const DriftSearch<Frames>& search, const Parameters& p) {
  return frames.pulled(std::exp(p[kWander]), std::exp(p[kMemory]), search.own(p));
}

// Errors' mean square in the tangent's own metric, relative to what rows' own noise alone would give.
template <class Frames>
double size_of(const Frames& frames, const DriftSearch<Frames>& search, const Parameters& p,
               const TangentMatrix& c) {
  const double relative = c.cwiseProduct(of_offsets(frames, search, p)).sum();
  return search.misfit(p).unit * (1 + relative / static_cast<double>(c.rows()));
}

// Satterthwaite's freedom of the covariance, by the likelihood's curvature in wander and memory.
template <class Frames>
double freedom_of(const Frames& frames, const DriftSearch<Frames>& search, const Parameters& at,
                  const TangentMatrix& c) {
  constexpr double kStep = 0.25;
  const double here = search.misfit(at).value, size = size_of(frames, search, at, c);
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
  const double prior = 2 / (kPriorWidth * kPriorWidth);
  const double of_wander = (value(h, 0) + value(-h, 0) - 2 * here) / (h * h) + prior;
  const double of_memory = (value(0, h) + value(0, -h) - 2 * here) / (h * h) + prior;
  const double of_both = (value(h, h) + value(-h, -h) - value(h, -h) - value(-h, h)) / (4 * h * h);
  const double by_wander = (log_size(h, 0) - log_size(-h, 0)) / (2 * h);
  const double by_memory = (log_size(0, h) - log_size(0, -h)) / (2 * h);
  const double determinant = of_wander * of_memory - of_both * of_both;
  double variance = 2 *
                    (of_memory * by_wander * by_wander - 2 * of_both * by_wander * by_memory +
                     of_wander * by_memory * by_memory) /
                    determinant;
  if (!(variance > 0) || determinant <= 0)
    variance = 2 * (by_wander * by_wander + by_memory * by_memory) * kPriorWidth;
  variance += 2 / frames.freedom();
  return std::max(2 / variance, kLeastFreedomLeft);
}

template <int kColumns>
Drift drift_as(const WhiteResiduals& white, const double* time, const std::int32_t* targets,
               const TangentMatrix& covariance) {
  Drift out;
  if (white.row.size() < 2 * kFewestTimes) return out;
  const DriftingFrames<kColumns> frames(white, time, targets);
  if (frames.count() < kFewestTimes || !(frames.freedom() > kLeastFreedomLeft)) return out;
  double excess = 0;
  for (double memory = 1.5; memory < frames.span(); memory *= 3)
    excess = std::max(excess, frames.excess(memory, covariance));
  if (!(excess > kScreened)) return out;

  const double row_variance = static_cast<double>(white.shift.size()) / white.shift.squaredNorm() / 1.5;
  DriftSearch search(frames, row_variance);
  const Parameters best = search.best();
  double without = frames.misfit(0, 1, 0).value;
  if (search.has_own())
    for (double own = -1e-2 * search.least_own(); own < row_variance * 1e3; own *= 1.5)
      without = std::min(without, frames.misfit(0, 1, own + search.least_own()).value);
  const auto misfit = search.misfit(best);
  if (!(without - misfit.value > kLeastGain)) return out;
  out.gain = without - misfit.value;
  out.unit = misfit.unit;
  out.wander = std::exp(best[kWander]);
  out.memory = std::exp(best[kMemory]);
  out.stretches = 1 + frames.span() / (2 * out.memory);
  out.freedom = freedom_of(frames, search, best, covariance);
  out.of_offsets = times(covariance, times(of_offsets(frames, search, best), covariance));
  return out;
}

}  // namespace

Drift drift_of(const WhiteResiduals& white, const double* time, const std::int32_t* targets,
               const TangentMatrix& covariance) {
  return (covariance.rows() > 8 ? drift_as<kMostParameters + 1> : drift_as<9>)(white, time, targets,
                                                                               covariance);
}

}  // namespace sonocal
