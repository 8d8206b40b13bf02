// Errors that neighbouring frames have in common.
#pragma once

#include <cstdint>

#include "sonocal/estimate/white_residuals.hpp"

namespace sonocal {

// White residuals taken as r = J d + s (e + B f + B b): each its own noise, an offset of the line for each
// frame, and an offset that wanders from frame to frame, of variance `wander` and correlation exp(-|time| /
// memory).
struct Drift {
  double gain = 0;           // twice the log of what drift gains; 0: none was found, and the rest is unset
  double unit = 1;           // s^2
  double wander = 0;         // variance of b, in the line's units squared and in units of s^2
  double memory = 0;         // in the unit of time
  double stretches = 0;      // as many independent errors the wandering offset has shown
  double freedom = 0;        // of the F distribution that errors under `covariance` have
  TangentMatrix of_offsets;  // what f and b do to the tangent's covariance, in units of s^2
};

// The drift that makes the residuals likeliest, by restricted maximum likelihood: what the fit has taken up
// of it is counted.
//
// time[row] of the table; rows of one frame have one time, neighbouring frames are some 1 apart. targets[row]
// (or null): an offset of each is taken out first. covariance: (J'J)^-1.
// Source: block tridiagonal form of a first-order autoregression (Rue and Held, Gaussian Markov Random
// Fields, 2005, section 2.4); restricted likelihood (Patterson and Thompson 1971).
Drift drift_of(const WhiteResiduals& white, const double* time, const std::int32_t* targets,
               const TangentMatrix& covariance);

}  // namespace sonocal
