// Points, lines and planes in any mix: the maximum of one likelihood.
#pragma once

#include <vector>

#include "sonocal/estimate/likelihood.hpp"

namespace sonocal {

struct MixedEstimate {
  Transform transform;
  TangentMatrix covariance;  // of the tangent, original units, with the noise in it; NaN: a motion is free
  double freedom = 0;        // degrees of freedom that the noise in it is known with
  NoiseLevels levels;
  std::vector<double> squares;  // of each sighting: mean squared distance of its points, mm^2
  int inliers = 0;
  bool converged = false;
};

// From a start, on the sightings within a distance, until both come to rest. `limit_mm`: infinite takes all.
MixedEstimate maximise_mixed(const MixedTable& table, const Transform& start, Model model, NoiseLevels known,
                             double limit_mm);

// The quadratic cost that its answer is the least of, in normalised coordinates.
NormalEquations mixed_cost(const MixedRows& rows, const bool* chosen, const Transform& at,
                           NoiseLevels levels);

}  // namespace sonocal
