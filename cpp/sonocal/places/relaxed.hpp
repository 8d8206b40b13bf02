// Calibration and place by linear equations: exact but for a linear map that need be no similarity.
#pragma once

#include <optional>

#include "sonocal/places/posed_rows.hpp"

namespace sonocal {

struct Relaxed {
  double cost = 0;  // of its rows' residuals, squared
  PlacesAnswer answer;
};

// The rows of one target, unknown but for the directions at right angles to it, which `along` brings with it:
//     n_k' R' (S x + t - t_i) = c_k
// is linear in the columns of S, in t and in c. The answer is the similarity nearest to it.
class RelaxedSystem {
 public:
  RelaxedSystem(const PosedRows& rows, const int* chosen, int count);
  // False where a motion is free.
  bool cost(const Place& along, double* cost);
  std::optional<Relaxed> solve(const Place& along);

 private:
  int equations(const Place& along);

  const PosedRows& rows_;
  const int* chosen_;
  const int count_;
  double h_[15][15], g_[15], c_;
};

}  // namespace sonocal
