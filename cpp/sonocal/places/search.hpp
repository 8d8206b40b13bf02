// The calibration and the place of one target, from nothing: samples, directions, consensus.
#pragma once

#include <cstdint>

#include "sonocal/places/posed_rows.hpp"

namespace sonocal {

struct PlaceSearch {
  double threshold_mm = 5;
  int most_samples = 400;
  double confidence = 0.999;
  std::uint64_t seed = 0;
};

struct PlaceCandidate {
  PlacesAnswer answer;
  double score;  // of all rows: squared distances, cut at the threshold; less is better
};

// Distinct answers, the best first. `rows` are of one target.
std::vector<PlaceCandidate> search_place(const PosedRows& rows, int scales, const PlaceSearch& options,
                                         int* samples = nullptr);

}  // namespace sonocal
