#include "sonocal/solvers/two_lines.hpp"

#include "sonocal/solvers/lanes/two_lines_lanes.hpp"

namespace sonocal {
namespace {

spatial::Lines<double> load_lines(const std::array<Line, 2>& lines) {
  return {{load(lines[0].point), load(lines[1].point)}, {load(lines[0].direction), load(lines[1].direction)}};
}

}  // namespace

int two_lines(const std::array<Line, 2>& image, const std::array<Line, 2>& needles,
              std::array<Transform, 2>& solutions) {
  Candidate<double> candidates[2];
  spatial::solve(load_lines(image), load_lines(needles), candidates);
  if (!candidates[0].valid || !candidates[1].valid) return 0;
  for (int i = 0; i < 2; ++i) write(candidates[i], solutions[i]);
  return 2;
}

void two_lines_batch(const double* image, const double* needles, std::size_t size, int threads,
                     BatchOut out) {
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    kernels(size).two_lines(image + begin * 12, needles + begin * 12, end - begin,
                            {out.matrices + begin * 32, out.counts + begin});
  });
}

}  // namespace sonocal
