// What rows seem to say of a motion and noise alone gives.
#pragma once

#include "sonocal/estimate/white_residuals.hpp"

namespace sonocal {

// Noise is in the derivatives of residuals, too, and H = J'WJ holds its square. Of needles in one plane the
// image points lie on one line; noise moves them off it, and H says that the turn about the line is known.
// What noise gives, M, is known from its levels. The rest, H - M, is what the rows say.
struct Apparent {
  // (I - H^-1 M)^-1. The corrected gradient has the variance H at most and the slope H - M, so that the
  // answer has (H - M)^-1 H (H - M)^-1. Source: Carroll, Ruppert, Stefanski and Crainiceanu, Measurement
  // Error in Nonlinear Models, 2006, chapter 7.
  TangentMatrix widening;
  // How far one standard deviation of the levels' ratio moves the answer: by it too much or too little is
  // corrected.
  Eigen::VectorXd moved;
  // Of H, where it is most, the share that noise may have: within three standard deviations of the levels'
  // ratio and of the squares of so many sightings' noise. At 1 there need be nothing else.
  double share;
};

Apparent apparent_of(const WhiteResiduals& white, double px_share, double ratio_variance,
                     const TangentMatrix& covariance);

}  // namespace sonocal
