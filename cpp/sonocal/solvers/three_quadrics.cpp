#include "sonocal/solvers/three_quadrics.hpp"

namespace sonocal {

int three_quadrics(const std::array<PointOnPlane, 7>& problem, std::array<Transform, 8>& solutions,
                   NoRealRoot policy) {
  double points[7][3], planes[7][4], matrices[8][16];
  std::int64_t count;
  for (int i = 0; i < 7; ++i)
    for (int k = 0; k < 4; ++k) {
      if (k < 3) points[i][k] = problem[i].point[k];
      planes[i][k] = k < 3 ? problem[i].normal[k] : problem[i].offset;
    }
  three_quadrics_batch(points[0], planes[0], 1, 7, policy, 1, {matrices[0], &count});
  for (int i = 0; i < count; ++i) solutions[i] = read_row_major(matrices[i]);
  return static_cast<int>(count);
}

void three_quadrics_batch(const double* points, const double* planes, std::size_t size, int rows,
                          NoRealRoot policy, int threads, BatchOut out) {
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    kernels(size).three_quadrics(points + begin * rows * 3, planes + begin * rows * 4, end - begin, rows,
                                 policy == NoRealRoot::kRealPart,
                                 {out.matrices + begin * 128, out.counts + begin});
  });
}

}  // namespace sonocal
