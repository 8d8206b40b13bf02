// Images as a voxel sees them: averaged over its size.
#pragma once

#include <cstddef>

namespace sonocal {

// The mean of across x down pixels around each pixel, rounded to the nearest; at the image's rim its pixels
// are repeated. Of an even number the last pixel counts half at each end. Exact: sums are whole numbers.
template <class Pixel>
void average_image(const Pixel* image, int width, int height, int across, int down, Pixel* averaged);

}  // namespace sonocal
