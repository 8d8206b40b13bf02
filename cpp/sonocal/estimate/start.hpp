// The transform that most sightings agree with: where refinement starts.
#pragma once

#include <vector>

#include "sonocal/estimate/table.hpp"

namespace sonocal {

struct Start {
  Transform transform;
  std::vector<Transform> others;  // that fit the rows that agree, locally as well as can be
  double limit = 0;               // squared distance, normalised, within which a row agrees
  int samples = 0;
  bool found = false;
  bool converged = false;
};

// Samples, local optimisation, refinement to convergence on the rows that agree (paper section 9), of a
// strided part of a large table.
Start start_of(const Table& table, const PointLines& rows, const Sightings& sightings,
               const Options& options);

}  // namespace sonocal
