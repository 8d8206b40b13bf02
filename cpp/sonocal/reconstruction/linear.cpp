#include <algorithm>
#include <cmath>
#include <limits>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/reconstruction/slices.hpp"

namespace sonocal {
namespace {

constexpr double kVoxel = 1.0 / static_cast<double>(kOneVoxel);

inline double fraction_of(std::int64_t x) { return static_cast<double>(x & (kOneVoxel - 1)) * kVoxel; }

// Two neighbours along x: (sum of w x, sum of w) of both lie side by side.
inline void give_pair(double* pair, double near, double far, double value) {
  pair[0] += near * value;
  pair[1] += near;
  pair[2] += far * value;
  pair[3] += far;
}

template <class Pixel>
void insert_row_linear(const PixelRow& row, const Box& box, const Pixel* pixels, int first, int last,
                       double* sums) {
  const std::int64_t wide = box.size[0] + 2, deep = wide * (box.size[1] + 2);
  std::int64_t at[3];
  for (int i = 0; i < 3; ++i) at[i] = row.at[i] + first * row.step[i] - (box.lo[i] - 1) * kOneVoxel;
  for (int u = first; u < last; ++u) {
    double* corner =
        sums + 2 * ((at[0] >> kFraction) + (at[1] >> kFraction) * wide + (at[2] >> kFraction) * deep);
    const double fx = fraction_of(at[0]), fy = fraction_of(at[1]), fz = fraction_of(at[2]);
    const double value = pixels[u], far = fy * fz, lower = fz - far, right = fy - far, near = 1 - fy - lower;
    give_pair(corner, near - near * fx, near * fx, value);
    give_pair(corner + 2 * wide, right - right * fx, right * fx, value);
    give_pair(corner + 2 * deep, lower - lower * fx, lower * fx, value);
    give_pair(corner + 2 * (wide + deep), far - far * fx, far * fx, value);
    for (int i = 0; i < 3; ++i) at[i] += row.step[i];
  }
}

constexpr double kMostCounted = 4294967295.0;

// Sums are the caller's: what no image adds up to is no number either.
double held_to(double x, double most) { return x > 0 ? std::min(x, most) : 0; }

// Pixels whose floor is in the box or in the layer before it reach a voxel of the box.
Box reached(const Box& box) {
  Box grown = box;
  for (int i = 0; i < 3; ++i) --grown.lo[i], ++grown.size[i];
  return grown;
}

}  // namespace

template <class Pixel>
void insert_linear(const Slices<Pixel>& s, const Box& box, double* sums) {
  const Box floors = reached(box);
  for (std::size_t i = 0; i < s.count; ++i) {
    allow_interrupt();
    const std::size_t k = s.which[i];
    const double* matrix = s.matrices + 12 * k;
    if (!near_enough(matrix, s.width, s.height)) continue;
    for (const Span* span = s.spans; span != s.spans + s.span_count; ++span) {
      const PixelRow row = row_of(matrix, span->row, 0);
      int first = span->first, last = span->last;
      clip(row, floors, first, last);
      insert_row_linear(row, box, s.pixels + (k * s.height + span->row) * s.width, first, last, sums);
    }
  }
}

template <class Pixel>
void settle_sums(const double* sums, const Box& box, Pixel* values, std::uint32_t* counts) {
  const std::size_t wide = box.size[0] + 2, deep = wide * (box.size[1] + 2);
  for (int z = 1; z <= box.size[2]; ++z)
    for (int y = 1; y <= box.size[1]; ++y) {
      const double* sum = sums + 2 * (z * deep + y * wide + 1);
      for (int x = 0; x < box.size[0]; ++x, sum += 2) {
        const bool some = sum[1] > 0;
        *values++ =
            some ? static_cast<Pixel>(held_to(sum[0] / sum[1] + 0.5, std::numeric_limits<Pixel>::max()))
                 : Pixel{0};
        *counts++ = some ? static_cast<std::uint32_t>(held_to(std::ceil(sum[1]), kMostCounted)) : 0;
      }
    }
}

template void insert_linear(const Slices<std::uint8_t>&, const Box&, double*);
template void insert_linear(const Slices<std::uint16_t>&, const Box&, double*);
template void settle_sums(const double*, const Box&, std::uint8_t*, std::uint32_t*);
template void settle_sums(const double*, const Box&, std::uint16_t*, std::uint32_t*);

}  // namespace sonocal
