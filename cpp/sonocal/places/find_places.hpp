// The calibration and the places of targets: from nothing, or from nearby.
#pragma once

#include <optional>

#include "sonocal/places/noise_growth.hpp"
#include "sonocal/places/search.hpp"
#include "sonocal/places/weighed_fit.hpp"

namespace sonocal {

struct PlacesOptions {
  int scales = 1;
  bool lag = false;
  double level_px = 1, level_mm = 0.3;  // standard deviations
  double rad_per_mm = 0.0116;
  bool levels_known = false;
  PlaceSearch search;
  std::optional<Transform> start;
};

struct FoundPlaces {
  PlacesFit fit;  // in the rows' coordinates
  NoiseGrowth growth;
  std::vector<double> distances;  // N, mm
  std::vector<bool> inlier;       // N
  double cost = 0;                // squared residuals in units of variance, cut where they are outliers
};

// Distinct answers, the best first; none where nothing was found.
std::vector<FoundPlaces> find_places(const PosedRows& rows, const PosedTable& table,
                                     const PlacesOptions& options);

}  // namespace sonocal
