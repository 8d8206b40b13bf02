// What an estimate is made from, and how.
#pragma once

#include "sonocal/estimate/noise_model.hpp"
#include "sonocal/estimate/samplers.hpp"
#include "sonocal/robust/consensus.hpp"

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
  double scale = 0;  // mm per px, where the model takes it for known
};

inline Sightings sightings_of(const Table& table) {
  return table.sightings ? Sightings::of_codes(table.sightings, table.rows)
                         : Sightings::single_rows(table.rows);
}

}  // namespace sonocal
