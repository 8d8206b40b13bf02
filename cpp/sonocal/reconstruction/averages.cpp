#include "sonocal/reconstruction/averages.hpp"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace sonocal {
namespace {

// Offsets of the four pixels that enter or leave twice the sum of `count` pixels as it moves on by one: of an
// odd number the same window is taken twice, of an even one two that are a pixel apart.
struct Window {
  int reach, shorter;
  explicit Window(int count) : reach(count / 2), shorter(count % 2 ? count / 2 : count / 2 - 1) {}
};

template <class Pixel>
void sums_along_row(const Pixel* row, int width, const Window& w, std::uint32_t* sums) {
  const auto at = [&](int u) -> std::uint32_t { return row[std::clamp(u, 0, width - 1)]; };
  std::uint32_t sum = 0;
  for (int u = -w.reach; u <= w.reach; ++u) sum += at(u);
  for (int u = -w.shorter; u <= w.shorter; ++u) sum += at(u);
  int u = 0;
  const auto slow = [&](int until) {
    for (; u < until; ++u) {
      sums[u] = sum;
      sum += at(u + w.reach + 1) - at(u - w.reach) + at(u + w.shorter + 1) - at(u - w.shorter);
    }
  };
  slow(std::min(w.reach, width));
  for (; u + w.reach + 1 < width; ++u) {
    sums[u] = sum;
    sum +=
        std::uint32_t{row[u + w.reach + 1]} - row[u - w.reach] + row[u + w.shorter + 1] - row[u - w.shorter];
  }
  slow(width);
}

}  // namespace

template <class Pixel>
void average_image(const Pixel* image, int width, int height, int across, int down, Pixel* averaged) {
  const Window along(across), below(down);
  const std::size_t wide = width;
  std::vector<std::uint32_t> rows(wide * height), sums(wide, 0);
  for (int v = 0; v < height; ++v) sums_along_row(image + v * wide, width, along, rows.data() + v * wide);
  const auto row = [&](int v) { return rows.data() + std::clamp(v, 0, height - 1) * wide; };
  const auto add = [&](int v) {
    const std::uint32_t* from = row(v);
    for (std::size_t u = 0; u < wide; ++u) sums[u] += from[u];
  };
  for (int v = -below.reach; v <= below.reach; ++v) add(v);
  for (int v = -below.shorter; v <= below.shorter; ++v) add(v);
  const double parts = 4.0 * across * down;
  for (int v = 0; v < height; ++v) {
    Pixel* into = averaged + v * wide;
    const std::uint32_t *in = row(v + below.reach + 1), *out = row(v - below.reach);
    const std::uint32_t *in2 = row(v + below.shorter + 1), *out2 = row(v - below.shorter);
    for (std::size_t u = 0; u < wide; ++u) {
      into[u] = static_cast<Pixel>(static_cast<std::int32_t>(sums[u] / parts + 0.5));
      sums[u] += in[u] - out[u] + in2[u] - out2[u];
    }
  }
}

template void average_image(const std::uint8_t*, int, int, int, int, std::uint8_t*);
template void average_image(const std::uint16_t*, int, int, int, int, std::uint16_t*);

}  // namespace sonocal
