#include "sonocal/solvers/four_points.hpp"

#include "sonocal/solvers/lanes/four_points_lanes.hpp"

namespace sonocal {

int four_points(const std::array<PointOnLine, 4>& problem, std::array<Transform, 4>& solutions,
                NoRealRoot policy) {
  planar::Problem<double> p;
  for (int i = 0; i < 4; ++i) {
    p.row[i].image = {problem[i].image.x(), problem[i].image.y()};
    p.row[i].foot = load(problem[i].point);
    p.row[i].direction = load(problem[i].direction);
  }
  planar::Solved<double> solved;
  const bool real_parts = policy == NoRealRoot::kRealPart;
  planar::solve(p, real_parts, solved);
  int count = 0;
  for (int i = 0; i < 4; ++i)
    if (solved.real[i]) write(solved.candidate[i], solutions[count++]);
  if (real_parts)
    for (int i = 0; i < 2; ++i)
      if (solved.part[i]) write(solved.candidate[2 * i], solutions[count++]);
  return count;
}

namespace {

// A pack for one problem would solve it several times.
void solve_one(const double* points, const double* segments, NoRealRoot policy, BatchOut out) {
  solve_each<4>(0, 1, out, [&](std::size_t, std::array<Transform, 4>& solutions) {
    std::array<PointOnLine, 4> problem;
    for (int i = 0; i < 4; ++i) {
      const Eigen::Map<const Vector3d> a(segments + 6 * i), b(segments + 6 * i + 3);
      problem[i] = {{points[2 * i], points[2 * i + 1]}, a, (b - a).normalized()};
    }
    return four_points(problem, solutions, policy);
  });
}

}  // namespace

void four_points_batch(const double* points, const double* segments, std::size_t size, NoRealRoot policy,
                       int threads, BatchOut out) {
  if (size == 1) return solve_one(points, segments, policy, out);
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    kernels(size).four_points(points + begin * 8, segments + begin * 24, end - begin,
                              policy == NoRealRoot::kRealPart,
                              {out.matrices + begin * 64, out.counts + begin});
  });
}

}  // namespace sonocal
