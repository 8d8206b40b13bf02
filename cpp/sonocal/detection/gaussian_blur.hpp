// Gaussian blur of an image; outside it there is nothing.
#pragma once

#include <vector>

namespace sonocal {

// In place; scratch has the image's size. Wide blurs are three box blurs, whose cost does not grow with the
// width and which differ from a Gaussian by 3 % at most (Wells, Efficient synthesis of Gaussian filters by
// cascaded uniform filters, IEEE PAMI 8, 1986).
void gaussian_blur(std::vector<float>& values, std::vector<float>& scratch, int rows, int cols, double sigma);

}  // namespace sonocal
