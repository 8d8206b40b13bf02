// How long frames repeat one another.
#pragma once

#include <cstdint>

namespace sonocal {

// Over how many consecutive frames the frames' mean residuals repeat one another: twice the sum of the
// positive autocorrelations up to the first that noise could give, plus one. 1 where neighbours have nothing
// in common.
//
// residuals: N x 3; frames: N numbers in the order of time, not necessarily without a gap.
// Source: integrated autocorrelation time (Sokal 1997, section 3).
int stretch_length(const double* residuals, const std::int32_t* frames, int rows);

}  // namespace sonocal
