// The whole estimate: consensus over minimal samples, then refinement on the rows that agree.
#pragma once

#include <cstdint>
#include <vector>

#include "sonocal/refine.hpp"

namespace sonocal {

struct Options {
  Model model = Model::kSimilarity;
  double threshold_mm = 5.0;  // paper section 9
  double confidence = 0.99999;
  int max_samples = 10000;
  int exhaustive_samples = 2000;  // go through all combinations where they are no more than this
  std::uint64_t seed = 0;
};

struct Estimate {
  Transform transform;
  TangentMatrix information;   // J'J over the inliers at the transform, mm^2 per tangent unit squared
  PointLines::Column squares;  // squared distance of every row, mm^2
  int inliers = 0;
  int samples = 0;     // minimal samples drawn
  int best_count = 0;  // rows that the best sample agreed with, also where there is no answer
  bool found = false;
  bool converged = false;
};

// sightings[i]: the number of row i's sighting, 0, 1, ...: rows of one sighting lie on one image line.
// 2D (dimension 2): samples are four rows (four_points). 3D: two sightings of at least two rows each
// (two_lines).
Estimate estimate(const PointLines& rows, const std::vector<int>& sightings, const Options& options);

// Refinement alone, on the rows with chosen[i], from a start in original coordinates.
Estimate refine_chosen(const PointLines& rows, const bool* chosen, const Transform& start, Model model,
                       int max_iterations);

}  // namespace sonocal
