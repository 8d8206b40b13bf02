// Whether chance could have made points agree with lines.
#pragma once

#include "sonocal/correspondences/chance.hpp"
#include "sonocal/estimate/table.hpp"

namespace sonocal {

// As `agreement` of correspondences, of sightings: `squares` is each one's mean squared distance.
Agreement agreement(const Table& table, const Transform& transform, const double* squares, double limit);

// Whether so many sightings agree that chance need not be counted: judged by a few hundred pairs, with a
// margin for their being few, at the distance of the furthest that agrees. True only where `agreement` says
// the same.
//
// `squares`: of each row; a sighting agrees where all of its rows do.
bool plainly_more(const Table& table, const Transform& transform, const double* squares, double limit);

}  // namespace sonocal
