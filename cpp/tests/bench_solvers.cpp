// Nanoseconds a problem without Python, least of many runs: configure with -DSONOCAL_CPP_TESTS=ON.
#include <algorithm>
#include <chrono>
#include <cstdio>

#include "problems.hpp"
#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/two_lines.hpp"

using namespace sonocal;

namespace {

template <class Run>
void measure(const char* name, int size, const Run& run) {
  double best = 1e9;
  for (int repeat = 0; repeat < 50; ++repeat) {
    const auto start = std::chrono::steady_clock::now();
    run();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  std::printf("%-28s %8.1f ns\n", name, 1e9 * best / size);
}

}  // namespace

int main() {
  constexpr int kSize = 10000;
  const Problems flat = make_problems(true, kSize, 1), space = make_problems(false, kSize, 2);
  std::vector<double> m(kSize * 128), needles;
  std::vector<std::int64_t> counts(kSize);
  for (int b = 0; b < 2 * kSize; ++b)
    needles.insert(needles.end(), &space.segments[b * 12], &space.segments[b * 12] + 6);
  const BatchOut out{m.data(), counts.data()};
  measure("four_points, batch", kSize, [&] {
    four_points_batch(flat.plane_points.data(), flat.segments.data(), kSize, NoRealRoot::kNothing, 1, out);
  });
  measure("four_points, one by one", kSize, [&] {
    for (int b = 0; b < kSize; ++b)
      four_points_batch(&flat.plane_points[b * 8], &flat.segments[b * 24], 1, NoRealRoot::kNothing, 1, out);
  });
  measure("two_lines, batch", kSize,
          [&] { two_lines_batch(space.points.data(), needles.data(), kSize, 1, out); });
  measure("two_lines, one by one", kSize, [&] {
    for (int b = 0; b < kSize; ++b) two_lines_batch(&space.points[b * 12], &needles[b * 12], 1, 1, out);
  });
  std::vector<double> x, planes;
  for (int b = 0; b < kSize; ++b) {
    std::array<PointOnPlane, 8> rows;
    point_planes(space, b, rows.data());
    for (int i = 0; i < 7; ++i) {
      x.insert(x.end(), rows[i].point.data(), rows[i].point.data() + 3);
      planes.insert(planes.end(), rows[i].normal.data(), rows[i].normal.data() + 3);
      planes.push_back(rows[i].offset);
    }
  }
  measure("three_quadrics, batch", kSize,
          [&] { three_quadrics_batch(x.data(), planes.data(), kSize, 7, 0, NoRealRoot::kNothing, 1, out); });
  measure("three_quadrics, one by one", kSize, [&] {
    for (int b = 0; b < kSize; ++b)
      three_quadrics_batch(&x[b * 21], &planes[b * 28], 1, 7, 0, NoRealRoot::kNothing, 1, out);
  });
}
