// Correspondences of any kind, each a few point-plane rows: consensus over minimal sets of them, refinement.
#pragma once

#include <cstdint>
#include <vector>

#include "sonocal/linalg/transform.hpp"
#include "sonocal/robust/consensus.hpp"

namespace sonocal {

struct Correspondences {
  const double* points;       // N x 3, source
  const double* planes;       // N x 4, target: (normal, offset), unit normals
  const std::int32_t* first;  // count + 1: correspondence c has the rows first[c] up to first[c + 1]
  int count;
};

struct CorrespondenceOptions {
  double threshold = 5.0;  // of a correspondence's distance; infinite: all agree
  bool refine = true;
  double fixed_scale = 0;           // where it is known; 0: found
  const double* weights = nullptr;  // count: what least squares multiplies residuals by; null: all alike
  ConsensusOptions consensus;
};

struct CorrespondenceEstimate {
  Transform transform;
  std::vector<double> squares;  // of each correspondence: mean squared distance of its points
  int inliers = 0;
  int samples = 0;
  bool found = false;
  bool converged = false;
};

// Samples are as many correspondences as determine a similarity, seven of whose rows give candidates (three
// quadrics; two conics, where all points are of one image), or six where the scale is known; the best are
// refined on all of them. The score is MSAC's.
CorrespondenceEstimate estimate(const Correspondences& correspondences, const CorrespondenceOptions& options);

}  // namespace sonocal
