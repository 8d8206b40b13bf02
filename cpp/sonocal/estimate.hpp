// The whole estimate: consensus, refinement on the rows that agree, covariance.
#pragma once

#include <optional>

#include "sonocal/consensus.hpp"
#include "sonocal/likelihood.hpp"
#include "sonocal/samplers.hpp"

namespace sonocal {

enum class Weighting {
  kGeometric,   // all distances alike: paper section 8
  kLikelihood,  // each by the noise it carries
};

// A table of sightings: raw arrays that outlive the call.
struct Table {
  const double* points;           // N x 3, px
  const double* segments;         // N x 2 x 3, mm
  const std::int32_t* sightings;  // N: rows of one sighting lie on one image line; null: each its own (2D)
  Labels labels;
  RowNoise noise;
  int rows;
  int dimension;
};

struct Options {
  Model model = Model::kSimilarity;
  Weighting weighting = Weighting::kLikelihood;
  double threshold_mm = 5.0;  // paper section 9; 0: from the noise
  NoiseLevels levels;         // a level of zero is estimated
  ConsensusOptions consensus;
};

struct Estimate {
  Transform transform;
  // Of the tangent, original units. Likelihood: with the noise in it. Geometric: for residuals of 1 mm.
  TangentMatrix covariance;
  PointLines::Column squares;  // squared distance of every row, mm^2
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

// Residuals of the rows with chosen[i], made independent and of unit variance under the levels: what a
// statistical model on top needs. Original units.
struct WhiteResiduals {
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian;  // M x k
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>
      shift;  // M x 3: derivative by a shift of the line
  // M x 2: derivative of the log of what was each residual's variance by the levels' squares, px^2 and mm^2.
  Eigen::Matrix<double, Eigen::Dynamic, 2, Eigen::RowMajor> by_level;
  Eigen::VectorXd residual;       // M
  std::vector<std::int32_t> row;  // M: a table row of the sighting
};
WhiteResiduals white_residuals(const Table& table, const bool* chosen, const Transform& at,
                               const Options& options);

}  // namespace sonocal
