// Batches of minimal problems.
#include <nanobind/stl/tuple.h>

#include <array>
#include <tuple>

#include "bind/arrays.hpp"
#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/two_lines.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

void write_row_major(const Matrix4d& m, double* out) {
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> map(out);
  map = m;
}

// Solves a batch of minimal problems: (B, most, 4, 4) with NaN after the last solution, and counts.
template <int kMost, class Solve>
std::tuple<Out<double>, Out<std::int64_t>> solve_batch(std::size_t batch, Solve solve) {
  std::vector<double> matrices(batch * kMost * 16, kNaN);
  std::vector<std::int64_t> counts(batch, 0);
  {
    nb::gil_scoped_release unlocked;
    std::array<Transform, kMost> solutions;
    for (std::size_t b = 0; b < batch; ++b) {
      counts[b] = solve(b, solutions);
      for (int k = 0; k < counts[b]; ++k)
        write_row_major(solutions[k].matrix(), matrices.data() + (b * kMost + k) * 16);
    }
  }
  return {make_array(std::move(matrices), {batch, kMost, 4, 4}), make_array(std::move(counts), {batch})};
}

Line line_through(const double* ends) {
  const Eigen::Map<const Vector3d> a(ends), b(ends + 3);
  return {a, (b - a).normalized()};
}

auto four_points_batch(In<double, nb::shape<-1, 4, 2>> points, In<double, nb::shape<-1, 4, 2, 3>> segments,
                       bool real_parts) {
  if (points.shape(0) != segments.shape(0)) throw nb::value_error("batches differ");
  const auto policy = real_parts ? NoRealRoot::kRealPart : NoRealRoot::kNothing;
  return solve_batch<4>(points.shape(0), [&](std::size_t b, std::array<Transform, 4>& solutions) {
    std::array<PointOnLine, 4> problem;
    for (int i = 0; i < 4; ++i) {
      const double* x = points.data() + (b * 4 + i) * 2;
      const Line line = line_through(segments.data() + (b * 4 + i) * 6);
      problem[i] = {{x[0], x[1]}, line.point, line.direction};
    }
    return four_points(problem, solutions, policy);
  });
}

auto two_lines_batch(In<double, nb::shape<-1, 2, 2, 3>> image, In<double, nb::shape<-1, 2, 2, 3>> needles) {
  if (image.shape(0) != needles.shape(0)) throw nb::value_error("batches differ");
  return solve_batch<2>(image.shape(0), [&](std::size_t b, std::array<Transform, 2>& solutions) {
    const double *x = image.data() + b * 12, *l = needles.data() + b * 12;
    return two_lines({line_through(x), line_through(x + 6)}, {line_through(l), line_through(l + 6)},
                     solutions);
  });
}

}  // namespace

void bind_solvers(nb::module_& m) {
  m.def("four_points", &four_points_batch, "points"_a.noconvert(), "segments"_a.noconvert(), "real_parts"_a);
  m.def("two_lines", &two_lines_batch, "image_segments"_a.noconvert(), "needle_segments"_a.noconvert());
}
