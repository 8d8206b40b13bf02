// Sums of squares, total and between groups of rows, and what they are expected to be.
#pragma once

#include <vector>

#include "sonocal/estimate/white_residuals.hpp"

namespace sonocal {

// White residuals taken as r = J d + e + sum_g B_g b_g: each its own noise and one offset of the line, of
// three numbers, for each group that it is in. `expected` times the variances of e and of every grouping's
// b_g is `observed`, in expectation, after the fit has taken its part: the total, then the squares between
// groups. Source: Henderson's method 3 (Searle, Casella and McCulloch, Variance Components, 1992, chapter 5).
struct SharedErrors {
  std::vector<int> kept;  // the groupings that can be told from the rest; the others have no part in the sums
  Eigen::MatrixXd expected;
  Eigen::VectorXd observed;
  std::vector<TangentMatrix> of_offsets;  // what unit offsets of each kept grouping do to the tangent
};

// codes[g][row]: the group of each row of the table, from 0 on. `units`: how many residuals' groups there are
// whatever they are grouped by; as many groups tell nothing.
SharedErrors shared_errors(const WhiteResiduals& white, const std::vector<const std::int32_t*>& codes,
                           int units, const TangentMatrix& covariance);

}  // namespace sonocal
