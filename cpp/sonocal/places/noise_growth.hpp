// Whether a motion is told by geometry, or by noise alone.
#pragma once

#include "sonocal/places/weighed_fit.hpp"

namespace sonocal {

// Noise turns geometry that leaves a motion free into some that seems to hold it. As much noise again tells:
// it multiplies what is known of such a motion, and leaves what geometry holds.
struct NoiseGrowth {
  double factor = 1;       // the most that a motion's information grows by
  Eigen::VectorXd motion;  // which, of the tangent
};
NoiseGrowth noise_growth(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                         PlaceLevels levels, double rad_per_mm, const PlacesAnswer& at, std::uint64_t seed);

}  // namespace sonocal
