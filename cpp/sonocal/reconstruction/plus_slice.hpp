// An image inserted into a volume as PLUS does it, voxel for voxel.
#pragma once

#include <cstdint>

namespace sonocal::plus {

enum class Compounding { mean, importance, maximum, latest };
enum class Arithmetic { unoptimised, doubles, fixed_point };

struct Settings {
  Compounding compounding;
  Arithmetic arithmetic;
  bool linear;
  double clip_origin[2], clip_size[2];  // px; a size of 0: the whole image
  double fan_angles_deg[2];             // both 0: no fan
  double fan_origin[2], fan_radii[2];   // px
  double rejection;                     // pixels darker than this are left out
};

struct Volume {
  std::uint8_t* values;
  std::uint16_t* weights;  // 256 an inserted pixel
  int size[3];             // x, y, z
};

struct Image {
  const std::uint8_t* pixels;
  const std::uint8_t* importance;  // of the same size, or null
  int width, height;
};

// Greatest weight, and the greatest that one more pixel may be added to.
constexpr int kFull = 65535, kPixel = 256, kNearlyFull = kFull - kPixel;

void insert_slice(const Volume& volume, const Image& image, const double* voxel_from_pixel,
                  const Settings& settings);

// A voxel without weight between two that have one, at most `limit` apart along one of 13 directions, is what
// a line between them says; of the shortest such sticks, all that tie and `most` at least are averaged.
void fill_with_sticks(const Volume& from, int limit, int most, std::uint8_t* values);

}  // namespace sonocal::plus
