// Batches of minimal problems.
#include <nanobind/stl/tuple.h>

#include <array>
#include <tuple>

#include "bind/arrays.hpp"
#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/three_quadrics.hpp"
#include "sonocal/solvers/two_lines.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using Solved = std::tuple<Out<double>, Out<std::int64_t>>;

// (B, most, 4, 4) matrices and (B,) counts, which `solve` fills to the last number.
template <class Solve>
Solved solve_batch(std::size_t size, std::size_t most, const Solve& solve) {
  auto* matrices = new double[size * most * 16];
  nb::capsule owns_matrices(matrices, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  auto* counts = new std::int64_t[size];
  nb::capsule owns_counts(counts, [](void* p) noexcept { delete[] static_cast<std::int64_t*>(p); });
  {
    nb::gil_scoped_release unlocked;
    solve(BatchOut{matrices, counts});
  }
  return {Out<double>(matrices, {size, most, 4, 4}, owns_matrices),
          Out<std::int64_t>(counts, {size}, owns_counts)};
}

void check_batches(std::size_t a, std::size_t b) {
  if (a != b) throw nb::value_error("batches differ");
}

Solved four_points_arrays(In<double, nb::shape<-1, 4, 2>> points, In<double, nb::shape<-1, 4, 2, 3>> segments,
                          bool real_parts, int threads) {
  check_batches(points.shape(0), segments.shape(0));
  const auto policy = real_parts ? NoRealRoot::kRealPart : NoRealRoot::kNothing;
  return solve_batch(points.shape(0), 4, [&](BatchOut out) {
    four_points_batch(points.data(), segments.data(), points.shape(0), policy, threads, out);
  });
}

Solved two_lines_arrays(In<double, nb::shape<-1, 2, 2, 3>> image, In<double, nb::shape<-1, 2, 2, 3>> needles,
                        int threads) {
  check_batches(image.shape(0), needles.shape(0));
  return solve_batch(image.shape(0), 2, [&](BatchOut out) {
    two_lines_batch(image.data(), needles.data(), image.shape(0), threads, out);
  });
}

Solved three_quadrics_arrays(In<double, nb::shape<-1, 7, 3>> points, In<double, nb::shape<-1, 7, 4>> planes,
                             int threads) {
  check_batches(points.shape(0), planes.shape(0));
  return solve_batch(points.shape(0), 8, [&](BatchOut out) {
    three_quadrics_batch(points.data(), planes.data(), points.shape(0), threads, out);
  });
}

}  // namespace

void bind_solvers(nb::module_& m) {
  m.def("four_points", &four_points_arrays, "points"_a.noconvert(), "segments"_a.noconvert(), "real_parts"_a,
        "threads"_a);
  m.def("two_lines", &two_lines_arrays, "image_segments"_a.noconvert(), "needle_segments"_a.noconvert(),
        "threads"_a);
  m.def("three_quadrics", &three_quadrics_arrays, "points"_a.noconvert(), "planes"_a.noconvert(),
        "threads"_a);
}
