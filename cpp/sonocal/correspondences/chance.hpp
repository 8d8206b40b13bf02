// How many correspondences would agree if sources and targets had nothing to do with each other.
#pragma once

#include "sonocal/correspondences/correspondences.hpp"

namespace sonocal {

// Log of the number of false alarms that a consensus may have: of random sets one of 5000 would pass were the
// background exact, and one of 1000 does as it is measured.
constexpr double kSure = -8.5;
// Residuals of this part of the scene's size: the source has shrunk to where a few targets nearly meet, or
// says nothing.
constexpr double kShrunk = 0.2;

struct Agreement {
  int agreeing = 0;        // correspondences within the threshold
  int by_chance = 0;       // where it is chance alone: as many agree with the best of all samples' models
  double share = 0;        // of correspondences that a model agrees with by chance
  double log_alarms = 0;   // log of how many models of samples agree as well by chance; below 0: a consensus
  bool redundant = false;  // whether more agree than a minimal sample, which any model fits
  // Where all agree and none is to spare, any would: there is nothing to test.
  bool by_chance_alone = true;
};

// Sources are held against the targets of other correspondences of their kind, under the transform found: the
// share of these pairs that is as near as a correspondence is how likely chance brings it there. The number
// of false alarms is the least of two, at the distance where it is least: samples times the binomial tail,
// and sets of correspondences times the ball that the residual of least squares lies in, times the density of
// pairs. Few rows to spare cannot show more than one of twenty: that is enough where the residual is like
// noise.
//
// `squares`: of each correspondence, mean squared distance of its points; `limit`: the threshold's square.
//
// Source: a-contrario model estimation, Moisan and Stival 2004, with the background measured; distances that
// choose themselves: Moisan, Moulon and Monasse 2012; the number of least-squares answers with a small
// residual is Rice's formula (Adler and Taylor 2007, 11.2).
Agreement agreement(const Correspondences& all, const Transform& transform, const double* squares,
                    double limit);

// Correspondences of an exact fit: those with the rows that hold seven motions.
int sample_of(int agreeing, double rows);

// Log of the number of false alarms where so many of all agree, each by chance with probability `share`.
double log_alarms(int count, int agreeing, int sample, double share);

}  // namespace sonocal
