// Where a target is, once the calibration says where its points were.
#pragma once

#include "sonocal/places/posed_rows.hpp"
#include "sonocal/robust/random.hpp"

namespace sonocal {

// By consensus of as many points as span it; `limit` is a squared distance.
Place place_seen(const std::vector<Vector3d>& seen, int spans, double limit, Random& random);

}  // namespace sonocal
