#include "sonocal/reconstruction/rows.hpp"

#include <algorithm>
#include <cmath>

namespace sonocal {
namespace {

std::int64_t floor_divide(std::int64_t a, std::int64_t b) {
  const std::int64_t q = a / b;
  return q - ((a % b != 0) && ((a < 0) != (b < 0)));
}

}  // namespace

PixelRow row_of(const double* m, int v, double shift) {
  PixelRow row;
  for (int i = 0; i < 3; ++i, m += 4) {
    row.at[i] = std::llrint((m[1] * v + m[3] + shift) * static_cast<double>(kOneVoxel));
    row.step[i] = std::llrint(m[0] * static_cast<double>(kOneVoxel));
  }
  return row;
}

void clip(const PixelRow& row, const Box& box, int& first, int& last) {
  std::int64_t from = first, until = last;
  for (int i = 0; i < 3; ++i) {
    const std::int64_t low = box.lo[i] * kOneVoxel - row.at[i];
    const std::int64_t high = (std::int64_t{box.lo[i]} + box.size[i]) * kOneVoxel - row.at[i];
    const std::int64_t step = row.step[i];
    if (step == 0) {
      if (low > 0 || high <= 0) until = first;
    } else if (step > 0) {  // low <= u step < high
      from = std::max(from, -floor_divide(-low, step));
      until = std::min(until, -floor_divide(-high, step));
    } else {
      from = std::max(from, floor_divide(high, step) + 1);
      until = std::min(until, floor_divide(low, step) + 1);
    }
  }
  first = static_cast<int>(std::min<std::int64_t>(from, last));
  last = static_cast<int>(std::clamp<std::int64_t>(until, first, last));
}

bool near_enough(const double* m, int width, int height) {
  for (int i = 0; i < 3; ++i, m += 4)
    for (int corner = 0; corner < 4; ++corner) {
      const double x = m[0] * (corner & 1 ? width : 0) + m[1] * (corner & 2 ? height : 0) + m[3];
      if (!(std::abs(x) < kFarthest)) return false;
    }
  return true;
}

}  // namespace sonocal
