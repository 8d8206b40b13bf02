// Threads over batches, and the bridge between lanes and Eigen.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <thread>
#include <vector>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/linalg/transform.hpp"
#include "sonocal/solvers/lanes/kernels.hpp"
#include "sonocal/solvers/lanes/lanes.hpp"

namespace sonocal {

enum class NoRealRoot {
  kNothing,   // complex pairs give no solution: exactly the solutions of the equations
  kRealPart,  // each complex pair gives its real part: a start for refinement
};

inline Vec3<double> load(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

inline void write(const Candidate<double>& c, Transform& out) {
  for (int k = 0; k < 3; ++k) out.rotation.col(k) << c.column[k].x, c.column[k].y, c.column[k].z;
  out.translation << c.translation.x, c.translation.y, c.translation.z;
  out.scales.setConstant(c.scale);
}

inline void write_row_major(const Transform& a, double* out) {
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> map(out);
  map = a.matrix();
}

inline Transform read_row_major(const double* in) {
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> m(in);
  Transform a;
  const double scale = m.topLeftCorner<3, 1>().norm();
  a.rotation = m.topLeftCorner<3, 3>() / scale;
  a.scales.setConstant(scale);
  a.translation = m.topRightCorner<3, 1>();
  return a;
}

// One problem after the other, for solvers without lanes: solve(b, solutions) returns the count.
template <int kMost, class Solve>
void solve_each(std::size_t begin, std::size_t end, BatchOut out, const Solve& solve) {
  std::array<Transform, kMost> solutions;
  for (std::size_t b = begin; b < end; ++b) {
    const int count = solve(b, solutions);
    double* m = out.matrices + b * kMost * 16;
    for (int k = 0; k < count; ++k) write_row_major(solutions[k], m + 16 * k);
    std::fill(m + 16 * count, m + 16 * kMost, kNoSolution);
    out.counts[b] = count;
  }
}

// Parts begin at whole packs, so that every problem is solved the same way wherever it falls.
inline constexpr std::size_t kBlock = 64;

template <class Solve>
void in_blocks(std::size_t begin, std::size_t end, const Solve& solve) {
  for (std::size_t b = begin; b < end; b += kBlock) {
    allow_interrupt();
    solve(b, std::min(end, b + kBlock));
  }
}

// Runs solve(begin, end) over 0 .. size, block by block, in equal parts. This thread does the last one, as
// the only one that can be told to stop; when it is, the others stop with it.
template <class Solve>
void in_threads(std::size_t size, int threads, const Solve& solve) {
  const std::size_t blocks = (size + kBlock - 1) / kBlock;
  const std::size_t parts = std::min<std::size_t>(std::max(threads, 1), std::max<std::size_t>(blocks, 1));
  const auto start = [&](std::size_t part) { return std::min(size, part * blocks / parts * kBlock); };
  std::atomic<bool> stop{false};
  std::vector<std::thread> workers;
  for (std::size_t p = 0; p + 1 < parts; ++p)
    workers.emplace_back([&, p] {
      const Helping helping(stop);
      try {
        in_blocks(start(p), start(p + 1), solve);
      } catch (const Stopped&) {
      }
    });
  const auto join = [&] {
    for (auto& worker : workers) worker.join();
  };
  try {
    in_blocks(start(parts - 1), size, solve);
  } catch (...) {
    stop = true;
    join();
    throw;
  }
  join();
}

}  // namespace sonocal
