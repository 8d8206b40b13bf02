// A row of an image as it runs through the voxels of a volume, in exact integer steps.
#pragma once

#include <cstdint>

namespace sonocal {

// Of 64 bits: so many are behind the point. A step that is rounded there is off by 1e-8 voxels after 2^14 px.
constexpr int kFraction = 40;
constexpr std::int64_t kOneVoxel = std::int64_t{1} << kFraction;
// Beyond so many voxels from the volume's origin nothing is inserted: what is added up stays far from
// overflow.
constexpr double kFarthest = 1 << 20;

// Voxels lo <= i < lo + size, along x, y and z.
struct Box {
  int lo[3];
  int size[3];
};

// Pixels first <= u < last of a row of the image: those that show ultrasound.
struct Span {
  int row, first, last;
};

// Where the row's pixels lie: at + u step, in units of 2^-40 voxels.
struct PixelRow {
  std::int64_t at[3];
  std::int64_t step[3];
};

// Source: `voxel_from_pixel` (3, 4), row by row, voxels from px; `shift` voxels are added, a half to round by
// a floor.
PixelRow row_of(const double* voxel_from_pixel, int v, double shift);

// Narrows [first, last) to the pixels whose floor is a voxel of the box.
void clip(const PixelRow& row, const Box& box, int& first, int& last);

// Whether the image's corners lie near enough to be inserted, each of them.
bool near_enough(const double* voxel_from_pixel, int width, int height);

}  // namespace sonocal
