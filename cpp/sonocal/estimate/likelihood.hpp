// Maximum likelihood: every residual weighted by what pixel noise and tracking noise make of it.
#pragma once

#include "sonocal/estimate/mixed_noise.hpp"
#include "sonocal/estimate/noise_model.hpp"
#include "sonocal/estimate/refine.hpp"

namespace sonocal {

// How far, as a standard deviation of its logarithm, the ratio of the two noises' shares in the residuals is
// expected from one: wide enough to be forgotten when the data know better, and all there is when they do
// not (few rows, or rows that all weigh the two alike).
constexpr double kRatioSpread = 2.0;

struct LikelihoodFit {
  Transform transform;
  NoiseLevels levels;         // px, mm
  TangentMatrix information;  // J' V^-1 J at the transform, normalised tangent
  bool converged = false;
};

// All of these are compiled for a `NoiseModel` and for a `MixedNoise`.

// From a start to the maximum of the likelihood. A level that is zero is estimated, by restricted maximum
// likelihood; one that is not is taken as known.
template <class Noise>
LikelihoodFit maximise_likelihood(const Noise& noise, const Transform& start, Model model, NoiseLevels known);

// The quadratic cost that the likelihood's maximum is the least of: with weights, and what they change by, as
// they are at a transform.
template <class Noise>
NormalEquations weighted_cost(const Noise& noise, const Transform& at, NoiseLevels levels);

// -2 log likelihood of the rows, but for a constant.
template <class Noise>
double deviance(const Noise& noise, const Transform& at, NoiseLevels levels);

}  // namespace sonocal
