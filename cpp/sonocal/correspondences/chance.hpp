// How many correspondences would agree if sources and targets had nothing to do with each other.
#pragma once

#include "sonocal/correspondences/correspondences.hpp"

namespace sonocal {

struct Agreement {
  int agreeing = 0;        // correspondences within the threshold
  int by_chance = 0;       // as many agree with the best of all samples' models where all is chance
  double share = 0;        // of correspondences that a model agrees with by chance
  double log_alarms = 0;   // log of how many models of samples agree as well by chance; below 0: a consensus
  bool redundant = false;  // whether more agree than a minimal sample, which any model fits
};

// Sources are held against the targets of other correspondences of their kind, under the transform found: the
// share of these pairs that is as near as a correspondence is how likely chance brings it there. The number
// of false alarms is that of samples times the binomial tail, at the distance where it is least.
//
// `squares`: of each correspondence, mean squared distance of its points; `limit`: the threshold's square.
//
// Source: a-contrario model estimation, Moisan and Stival 2004, with the background measured; distances that
// choose themselves: Moisan, Moulon and Monasse 2012.
Agreement agreement(const Correspondences& all, const Transform& transform, const double* squares,
                    double limit);

}  // namespace sonocal
