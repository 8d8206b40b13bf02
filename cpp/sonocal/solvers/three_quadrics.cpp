#include "sonocal/solvers/three_quadrics.hpp"

namespace sonocal {
namespace {

template <std::size_t kRows>
int solve_one(const std::array<PointOnPlane, kRows>& problem, double scale, NoRealRoot policy,
              std::array<Transform, 8>& solutions) {
  double points[kRows][3], planes[kRows][4], matrices[8][16];
  std::int64_t count;
  for (std::size_t i = 0; i < kRows; ++i)
    for (int k = 0; k < 4; ++k) {
      if (k < 3) points[i][k] = problem[i].point[k];
      planes[i][k] = k < 3 ? problem[i].normal[k] : problem[i].offset;
    }
  three_quadrics_batch(points[0], planes[0], 1, kRows, scale, policy, 1, {matrices[0], &count});
  for (int i = 0; i < count; ++i) solutions[i] = read_row_major(matrices[i]);
  return static_cast<int>(count);
}

}  // namespace

int three_quadrics(const std::array<PointOnPlane, 7>& problem, std::array<Transform, 8>& solutions,
                   NoRealRoot policy) {
  return solve_one(problem, 0, policy, solutions);
}

int three_quadrics(const std::array<PointOnPlane, 6>& problem, double scale,
                   std::array<Transform, 8>& solutions, NoRealRoot policy) {
  return solve_one(problem, scale, policy, solutions);
}

void three_quadrics_batch(const double* points, const double* planes, std::size_t size, int rows,
                          double scale, NoRealRoot policy, int threads, BatchOut out) {
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    kernels(size).three_quadrics(points + begin * rows * 3, planes + begin * rows * 4, end - begin, rows,
                                 scale, policy == NoRealRoot::kRealPart,
                                 {out.matrices + begin * 128, out.counts + begin});
  });
}

}  // namespace sonocal
