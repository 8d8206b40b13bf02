// Images inserted into voxels: each pixel into the nearest, or spread over the eight around it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sonocal/reconstruction/cells.hpp"
#include "sonocal/reconstruction/rows.hpp"

namespace sonocal {

// Images of one size, one after the other, and which of them to insert, in this order.
template <class Pixel>
struct Slices {
  const Pixel* pixels;        // (n, height, width)
  const double* matrices;     // (n, 3, 4): voxel_from_pixel
  const std::int32_t* which;  // (count,)
  std::size_t count;
  int width, height;
  const Span* spans;
  std::size_t span_count;
};

// Each pixel is given to the voxel whose centre is nearest: cells of the box, x fastest.
template <class Pixel>
void insert_nearest(const Slices<Pixel>& slices, const Box& box, Compounding how, std::uint64_t* cells);

// Each pixel is spread over the eight voxels around it, by trilinear weights: (sum of w x, sum of w) of every
// voxel of the box and of one further layer on all its sides, x fastest.
template <class Pixel>
void insert_linear(const Slices<Pixel>& slices, const Box& box, double* sums);

// Values, rounded to the nearest, and counts of pixels (weights, rounded up) of the box without its further
// layer.
template <class Pixel>
void settle_sums(const double* sums, const Box& box, Pixel* values, std::uint32_t* counts);

}  // namespace sonocal
