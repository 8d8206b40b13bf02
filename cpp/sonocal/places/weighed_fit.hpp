// The likelihood of a calibration and of places: pixel noise, and that of the poses, which rows of one
// instant share.
#pragma once

#include <Eigen/Core>

#include "sonocal/places/posed_rows.hpp"

namespace sonocal {

// Variances: of a pixel's coordinate; of a pose's translation along an axis. A pose turns by `rad_per_mm`
// times the deviation of the latter about each axis, about its marker.
struct PlaceLevels {
  double px = 0, mm = 0;
};

struct PlacesFit {
  PlacesAnswer answer;
  PlaceLevels levels;
  Eigen::MatrixXd covariance;  // of the tangent, with those levels
  Eigen::MatrixXd nominal;     // with the levels that were expected where those are less
  double freedom = 0;
  double rest = 0;  // length of the last step, in standard deviations
};

struct PlacesNoise {
  PlaceLevels expected;
  bool estimated;     // or taken as they are
  double rad_per_mm;  // per the rows' own unit of length
};

// From nearby, on chosen rows (in order).
PlacesFit fit_places(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                     const PlacesNoise& noise, const PlacesAnswer& start);

// J' V^-1 J of the tangent, with what is known of places.
Eigen::MatrixXd information(const PosedRows& rows, const std::vector<int>& chosen, const Unknowns& unknowns,
                            PlaceLevels levels, double rad_per_mm, const PlacesAnswer& at);

// Each row's squared residuals in units of their variance, all rows.
std::vector<double> chi_squared(const PosedRows& rows, const PlacesAnswer& at, PlaceLevels levels,
                                double rad_per_mm);

}  // namespace sonocal
