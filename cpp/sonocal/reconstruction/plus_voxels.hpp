// What PLUS does to the voxels that one pixel reaches.
#pragma once

#include "sonocal/reconstruction/plus_numbers.hpp"
#include "sonocal/reconstruction/plus_slice.hpp"

namespace sonocal::plus {

inline std::int64_t index_of(const Volume& volume, int x, int y, int z) {
  return (static_cast<std::int64_t>(z) * volume.size[1] + y) * volume.size[0] + x;
}

inline bool inside(const Volume& v, const int* low, const int* high) {
  for (int i = 0; i < 3; ++i)
    if (low[i] < 0 || high[i] >= v.size[i]) return false;
  return true;
}

// A running mean whose remainder is cut off each time; once full, a voxel keeps 255/256 of what it was.
inline void average(std::uint8_t& value, std::uint16_t& weight, int pixel, int part) {
  if (weight > kNearlyFull) {
    value = static_cast<std::uint8_t>(pixel * (1.0 / 256) + value * (255.0 / 256));
    return;
  }
  const int sum = weight + part;
  value = static_cast<std::uint8_t>((pixel * part + value * weight) / sum);
  weight = static_cast<std::uint16_t>(sum);
}

// One of the eight voxels around a pixel, whose trilinear weight is `share`.
template <class Number>
void give_share(std::uint8_t& value, std::uint16_t& weight, int pixel, int importance, Number share,
                Compounding how) {
  Number sum = whole<Number>(weight);
  if (how == Compounding::mean) {
    const Number known = from<Number>(weight / 256.0);
    sum = share + known;
    value = static_cast<std::uint8_t>(round_of((share * pixel + known * value) / sum));
    sum = sum * kPixel;
  } else if (how == Compounding::importance) {
    if (importance == 0) return;
    sum = share * importance + whole<Number>(weight);
    const Number mixed = share * (pixel * importance) / sum + whole<Number>(weight) / sum * value;
    value = static_cast<std::uint8_t>(round_of(mixed));
  } else if (!(share < from<Number>(0.125)) && (how == Compounding::latest || pixel > value)) {
    value = static_cast<std::uint8_t>(pixel);
    sum = share * kPixel;
  }
  weight = sum < whole<Number>(kFull) ? static_cast<std::uint16_t>(round_of(sum)) : kFull;
}

// Eight voxels, the furthest first; a pixel of which one would lie outside is left out.
template <class Number>
void give_linear(const Volume& volume, const Number* at, int pixel, int importance, Compounding how) {
  int low[3], high[3];
  Number part[3][2];
  for (int i = 0; i < 3; ++i) {
    low[i] = floor_of(at[i]);
    part[i][1] = at[i] - whole<Number>(low[i]);
    part[i][0] = whole<Number>(1) - part[i][1];
    high[i] = low[i] + !is_zero(part[i][1]);
  }
  if (!inside(volume, low, high)) return;
  for (int corner = 7; corner >= 0; --corner) {
    const int x = corner >> 2 & 1, y = corner >> 1 & 1, z = corner & 1;
    const Number share = part[0][x] * (part[1][y] * part[2][z]);
    if (is_zero(share)) continue;
    const auto index = index_of(volume, x ? high[0] : low[0], y ? high[1] : low[1], z ? high[2] : low[2]);
    give_share(volume.values[index], volume.weights[index], pixel, importance, share, how);
  }
}

}  // namespace sonocal::plus
