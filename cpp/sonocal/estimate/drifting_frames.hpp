// What frames' residuals say of an offset of the line that wanders from frame to frame.
#pragma once

#include <vector>

#include "sonocal/estimate/white_residuals.hpp"

namespace sonocal {

// White residuals summed over the rows of each frame, in the order of time: r = J d + s (e + B f + B b), see
// drift.hpp.
//
// kColumns: the tangent's columns and the residual's own; one that is not used stays zero, for sizes known
// when compiled.
template <int kColumns>
class DriftingFrames {
 public:
  using Pull = Eigen::Matrix<double, 3, kColumns>;
  using Square = Eigen::Matrix<double, kColumns, kColumns>;

  DriftingFrames(const WhiteResiduals& white, const double* time, const std::int32_t* targets);

  int count() const { return static_cast<int>(frames_.size()); }
  double freedom() const { return freedom_; }
  double span() const { return frames_.back().time - frames_.front().time; }

  // By how many standard deviations of chance the products of frames' residuals, weighted by exp(-|time| /
  // memory), exceed what independent rows would give.
  double excess(double memory, const TangentMatrix& covariance) const;

  // Minus twice the log of the restricted likelihood, and s^2.
  struct Misfit {
    double value, unit;
  };
  Misfit misfit(double wander, double memory, double own) const;

  // J'B K B'J with K = wander exp(-|time| / memory), and `own` more of one frame with itself.
  TangentMatrix pulled(double wander, double memory, double own) const;

  // Pairs of residuals a frame: more than one tell what a frame has of its own from what single rows have.
  double pairs_each() const { return (freedom_ + taken_ + parameters_) / (2.0 * count()); }
  // The greatest part of its weight that an offset of a frame's own can take from the rows' noise: in a
  // volume, where levels that drift has blown up weigh a sighting's place too lightly, it is less than what
  // they say.
  double most_weight() const;

 private:
  // What a frame's rows say of an offset of the line: B'B, and B'[J r].
  struct Frame {
    double time;
    Eigen::Matrix3d weight;
    Pull pull;
  };

  double kept(int t, double memory) const;
  Eigen::VectorXd without_targets(const WhiteResiduals& white, const std::int32_t* targets);

  std::vector<Frame> frames_;
  Square whole_;  // [J r]'[J r]
  int parameters_ = 0;
  double freedom_ = 0, taken_ = 0;
};

extern template class DriftingFrames<9>;
extern template class DriftingFrames<kMostParameters + 1>;

}  // namespace sonocal
