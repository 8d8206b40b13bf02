// What a voxel has been given so far, in 64 bits: how often, and the sum, the greatest or the latest of it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sonocal {

enum class Compounding { mean, maximum, latest };

// A count of 24 bits above a sum of 40: of 16-bit pixels the count is full first.
constexpr int kSumBits = 40;
constexpr std::uint64_t kOnce = std::uint64_t{1} << kSumBits;
constexpr std::uint64_t kSumMask = kOnce - 1;

template <Compounding how>
inline void give(std::uint64_t& cell, std::uint64_t value) {
  if constexpr (how == Compounding::mean) {
    cell += kOnce | value;
  } else if constexpr (how == Compounding::maximum) {
    const std::uint64_t known = cell & kSumMask;
    cell = (cell & ~kSumMask) + kOnce + (value > known ? value : known);
  } else {
    cell = (cell & ~kSumMask) + kOnce + value;
  }
}

// Values, rounded to the nearest, and counts; a voxel that was given nothing is 0. `scale`: units of a grey
// level.
template <class Pixel>
void settle_cells(const std::uint64_t* cells, std::size_t count, Compounding how, std::uint64_t scale,
                  Pixel* values, std::uint32_t* counts);

}  // namespace sonocal
