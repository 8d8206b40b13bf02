// The whole estimate: consensus, refinement on the rows that agree, covariance.
#pragma once

#include "sonocal/estimate/table.hpp"

namespace sonocal {

struct Estimate {
  Transform transform;
  // Of the tangent, original units. Likelihood: with the noise in it. Geometric: for residuals of 1 mm.
  TangentMatrix covariance;
  PointLines::Column squares;  // squared distance of every row, mm^2
  double squared_sum = 0;      // of the rows that agree, mm^2
  NoiseLevels levels;          // likelihood: px and mm
  double threshold_mm = 0;
  double least_information = 0;  // least eigenvalue of J'J a row in coordinates of order one
  int inliers = 0;               // also where there is no answer: of the best there was
  int samples = 0;
  bool found = false;
  bool converged = false;
};

Estimate estimate(const Table& table, const Options& options);

// Refinement alone, on the rows with chosen[i], from a start.
Estimate refine_chosen(const Table& table, const bool* chosen, const Transform& start,
                       const Options& options);

}  // namespace sonocal
