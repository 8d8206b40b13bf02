// Voxels between two successive images, along the path of the probe.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sonocal/reconstruction/cells.hpp"
#include "sonocal/reconstruction/rows.hpp"

namespace sonocal {

// Images of one size, in the order in which the probe passed them.
template <class Pixel>
struct Passage {
  const Pixel* pixels;         // (count, height, width)
  const double* matrices;      // (count, 3, 4): (u, v, w) px, px, mm from voxels; w off the image's plane
  const std::uint8_t* joined;  // (count - 1,): whether the probe passed steadily from an image to the next
  std::size_t count;
  int width, height;
  const std::uint8_t* mask;  // (height, width): not 0 where to look
};

// Units of a grey level in these cells: a quarter of a pixel's weight by 64 is as fine as a pixel's own
// rounding.
constexpr std::uint64_t kGreyParts = 256;

// A voxel x between image k and the next is seen by an image in between, from where the probe was then:
//     t = w_k / (w_k - w_k+1),  (u, v) = (1 - t) (u, v)_k + t (u, v)_k+1,  (1 - t) I_k(u, v) + t I_k+1(u, v)
// Source: Coupé et al., "3D freehand ultrasound reconstruction based on probe trajectory", MICCAI 2005.
template <class Pixel>
void insert_between(const Passage<Pixel>& passage, const Box& box, Compounding how, std::uint64_t* cells);

// Voxels within so many mm of the plane of an image that is not joined on both sides; `first` and `last` say
// whether those images are joined to some that are not among these.
template <class Pixel>
void insert_alone(const Passage<Pixel>& passage, const Box& box, double half_mm, bool first, bool last,
                  Compounding how, std::uint64_t* cells);

}  // namespace sonocal
