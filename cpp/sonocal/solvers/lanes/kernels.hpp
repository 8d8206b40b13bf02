// Minimal solvers over ranges of a batch, compiled for several generations of processors.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>

namespace sonocal {

constexpr double kNoSolution = std::numeric_limits<double>::quiet_NaN();

// Solutions of problem b: matrices[b * most ...], 4 x 4 row-major, kNoSolution after the last; counts[b].
struct BatchOut {
  double* matrices;
  std::int64_t* counts;
};

// Each takes the number of problems of its range and pointers to the first.
struct Kernels {
  const char* name;  // "base", "avx2", "avx512"
  void (*four_points)(const double* points, const double* segments, std::size_t size, bool real_parts,
                      BatchOut out);
  void (*two_lines)(const double* image, const double* needles, std::size_t size, BatchOut out);
  // The scale is known where it is above 0.
  void (*three_quadrics)(const double* points, const double* planes, std::size_t size, int rows, double scale,
                         bool real_parts, BatchOut out);
  void (*two_conics)(const double* points, const double* planes, std::size_t size, int rows, bool real_parts,
                     BatchOut out);
};

// Those for this machine and so many problems: one problem does not fill wide registers, and waits for them.
const Kernels& kernels(std::size_t size);

}  // namespace sonocal
