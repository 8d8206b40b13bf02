#include <algorithm>
#include <cmath>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/reconstruction/plus_voxels.hpp"

namespace sonocal::plus {
namespace {

constexpr int kSticks = 13;
constexpr int kDirections[kSticks][3] = {{1, 0, 0},  {0, 1, 0},  {0, 0, 1},  {1, 1, 0},  {1, 0, 1},
                                         {0, 1, 1},  {1, -1, 0}, {1, 0, -1}, {0, 1, -1}, {1, 1, 1},
                                         {-1, 1, 1}, {1, -1, 1}, {-1, -1, 1}};

// The first voxel with a weight, at most `most` steps away; 0 where there is none.
int steps_to(const Volume& v, const int* at, const int* direction, int sign, int most, std::uint8_t& value) {
  for (int step = 1; step <= most; ++step) {
    int place[3];
    for (int i = 0; i < 3; ++i) place[i] = at[i] + sign * step * direction[i];
    if (!inside(v, place, place)) return 0;
    const auto index = index_of(v, place[0], place[1], place[2]);
    if (v.weights[index] != 0) {
      value = v.values[index];
      return step;
    }
  }
  return 0;
}

struct Stick {
  double weight;  // 0: no such stick
  std::uint8_t value;
};

Stick stick(const Volume& v, const int* at, const int* direction, int limit) {
  std::uint8_t ahead = 0, behind = 0;
  const int forth = steps_to(v, at, direction, 1, limit - 1, ahead);
  if (forth == 0) return {0, 0};
  const int back = steps_to(v, at, direction, -1, limit - 1 - forth, behind);
  if (back == 0) return {0, 0};
  const double length = forth + back + 1, share = (back + 1) / length;
  int squared = 0;
  for (int i = 0; i < 3; ++i) squared += direction[i] * direction[i];
  const double value = (1.0 - share) * behind + share * ahead;
  return {1.0 / (length * std::sqrt(static_cast<double>(squared))), static_cast<std::uint8_t>(value)};
}

std::uint8_t filled(const Volume& v, const int* at, int limit, int most) {
  Stick sticks[kSticks];
  for (int i = 0; i < kSticks; ++i) sticks[i] = stick(v, at, kDirections[i], limit);
  double sum = 0, weights = 0;
  for (int used = 0; used < most;) {
    double best = 0;
    for (const Stick& one : sticks) best = std::max(best, one.weight);
    if (best == 0) break;
    for (Stick& one : sticks)
      if (one.weight == best) {
        sum += one.value * one.weight;
        weights += one.weight;
        one.weight = 0;
        ++used;
      }
  }
  return weights == 0 ? 0 : static_cast<std::uint8_t>(sum / weights);
}

}  // namespace

void fill_with_sticks(const Volume& from, int limit, int most, std::uint8_t* values) {
  int at[3];
  for (at[2] = 0; at[2] < from.size[2]; ++at[2]) {
    allow_interrupt();
    for (at[1] = 0; at[1] < from.size[1]; ++at[1])
      for (at[0] = 0; at[0] < from.size[0]; ++at[0]) {
        const auto index = index_of(from, at[0], at[1], at[2]);
        values[index] = from.weights[index] != 0 ? from.values[index] : filled(from, at, limit, most);
      }
  }
}

}  // namespace sonocal::plus
