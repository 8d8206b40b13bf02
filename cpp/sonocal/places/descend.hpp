// Least squares of distances from places that are found with the calibration.
#pragma once

#include "sonocal/places/posed_rows.hpp"

namespace sonocal {

struct Descent {
  int iterations = 20;
  // A row at this distance weighs a quarter (Geman and McClure); infinity: all alike.
  double scale = 1e300;
  double tolerance = 1e-10;  // of the cost
};

// From an answer to one nearby, in place; the cost there. Levenberg and Marquardt.
double descend(const PosedRows& rows, const int* chosen, int count, const Unknowns& unknowns,
               const Descent& how, PlacesAnswer& at);

}  // namespace sonocal
