// Batches of minimal problems: leading axes in, the same leading axes out.
#include <nanobind/stl/tuple.h>

#include <array>
#include <memory>
#include <optional>
#include <tuple>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/gauss_newton.hpp"
#include "sonocal/solvers/linear.hpp"
#include "sonocal/solvers/paper.hpp"
#include "sonocal/solvers/three_points.hpp"
#include "sonocal/solvers/three_quadrics.hpp"
#include "sonocal/solvers/two_conics.hpp"
#include "sonocal/solvers/two_lines.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using Array = In<double>;
constexpr int kMostSteps = 1000;
constexpr const char* kOtherShapes = "shapes are not those of this solver's problems";
// Matrices, and counts: a number where one problem was given, an array cost a microsecond.
using Solved = std::tuple<Out<double>, nb::object>;

// What every solver takes: steps 0 solves seven equations exactly, more of them refine on all; scale > 0
// is known; threads share the batch.
struct Refining {
  Refining(int steps_, double scale_, int threads_) : steps(steps_), scale(scale_), threads(threads_) {
    require(steps >= 0 && steps <= kMostSteps, "steps is not between 0 and 1000");
    require(usable(scale) && scale >= 0, "scale is not a number from 0 on");
    check_threads(threads);
  }
  int steps;
  double scale;
  int threads;
  NoRealRoot policy() const { return steps > 0 ? NoRealRoot::kRealPart : NoRealRoot::kNothing; }
};

// The axes before the problem's own.
struct Leading {
  std::array<std::size_t, 16> shape;
  std::size_t axes = 0, size = 1;

  Leading(const Array& a, std::initializer_list<std::size_t> tail) {
    const std::size_t own = tail.size();
    bool fits = a.ndim() >= own && a.ndim() - own < shape.size() - 3;
    for (std::size_t i = 0; fits && i < own; ++i) {
      const std::size_t wanted = *(tail.begin() + i);
      fits = wanted == 0 || a.shape(a.ndim() - own + i) == wanted;
    }
    if (!fits) throw nb::value_error(kOtherShapes);
    for (; axes < a.ndim() - own; ++axes) size *= shape[axes] = a.shape(axes);
  }
  void must_equal(const Leading& other) const {
    bool same = axes == other.axes;
    for (std::size_t i = 0; same && i < axes; ++i) same = shape[i] == other.shape[i];
    if (!same) throw nb::value_error("shapes differ in their leading axes");
  }
};

template <class T>
Out<T> adopt(T* data, const std::size_t* shape, std::size_t axes) {
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return Out<T>(data, axes, shape, owner);
}

// (..., most, 4, 4) matrices and (...,) counts, which `solve` fills to the last number.
template <class Solve>
Solved solve_batch(Leading leading, std::size_t most, const Solve& solve) {
  std::unique_ptr<double[]> matrices(new double[leading.size * most * 16]);
  std::unique_ptr<std::int64_t[]> counts(new std::int64_t[leading.size]);
  {
    // One problem is over before the lock could change hands.
    std::optional<nb::gil_scoped_release> unlocked;
    if (leading.axes > 0) unlocked.emplace();
    solve(BatchOut{matrices.get(), counts.get()});
  }
  nb::object counted;
  if (leading.axes == 0) {
    counted = nb::int_(counts[0]);
  } else {
    counted = nb::cast(adopt(counts.release(), leading.shape.data(), leading.axes));
  }
  leading.shape[leading.axes] = most;
  leading.shape[leading.axes + 1] = leading.shape[leading.axes + 2] = 4;
  return {adopt(matrices.release(), leading.shape.data(), leading.axes + 3), std::move(counted)};
}

Line line_through(const double* ends) {
  const Eigen::Map<const Vector3d> a(ends), b(ends + 3);
  return {a, (b - a).normalized()};
}

// Two rows for each of four points on lines; point i has `dimension` numbers.
void rows_of_points(const double* points, int dimension, const double* segments, PointOnPlane* rows) {
  for (int i = 0; i < 4; ++i) {
    const double* x = points + dimension * i;
    const Line line = line_through(segments + 6 * i);
    planes_of_line({x[0], x[1], dimension > 2 ? x[2] : 0.0}, line.point, line.direction, rows + 2 * i);
  }
}

void rows_of_lines(const double* image, const double* needles, PointOnPlane* rows) {
  for (int i = 0; i < 4; ++i) {
    const Line line = line_through(needles + 6 * (i / 2));
    planes_of_line({image[3 * i], image[3 * i + 1], image[3 * i + 2]}, line.point, line.direction,
                   rows + 2 * i);
  }
}

Solved four_points_arrays(Array points, Array segments, int steps, double scale, int threads) {
  const Refining o(steps, scale, threads);
  const Leading leading(points, {4, 2});
  leading.must_equal(Leading(segments, {4, 2, 3}));
  const double *x = points.data(), *l = segments.data();
  return solve_batch(leading, 4, [&](BatchOut out) {
    four_points_batch(x, l, leading.size, o.policy(), o.threads, out);
    if (o.steps > 0)
      refine_batch<4>(
          leading.size, o.threads, 8, o.steps, o.scale, out,
          [&](std::size_t b, PointOnPlane* rows) { rows_of_points(x + b * 8, 2, l + b * 24, rows); });
  });
}

Solved two_lines_arrays(Array image, Array needles, int steps, double scale, int threads) {
  const Refining o(steps, scale, threads);
  const Leading leading(image, {2, 2, 3});
  leading.must_equal(Leading(needles, {2, 2, 3}));
  const double *x = image.data(), *l = needles.data();
  return solve_batch(leading, 2, [&](BatchOut out) {
    two_lines_batch(x, l, leading.size, o.threads, out);
    if (o.steps > 0)
      refine_batch<2>(
          leading.size, o.threads, 8, o.steps, o.scale, out,
          [&](std::size_t b, PointOnPlane* rows) { rows_of_lines(x + b * 12, l + b * 12, rows); });
  });
}

// Refines on all of the rows that were given.
template <int kMost>
void refine_rows(const Refining& o, const double* points, const double* planes, std::size_t size, int rows,
                 BatchOut out) {
  if (o.steps == 0) return;
  refine_batch<kMost>(size, o.threads, rows, o.steps, o.scale, out, [&](std::size_t b, PointOnPlane* to) {
    for (int i = 0; i < rows; ++i) to[i] = read_row(points, planes, b * rows + i);
  });
}

// How many rows each problem has, at least `fewest`.
int rows_of(const Array& points, const Array& planes, const Leading& leading, int fewest) {
  const auto rows = static_cast<int>(points.shape(leading.axes));
  if (rows < fewest || static_cast<int>(planes.shape(leading.axes)) != rows)
    throw nb::value_error(kOtherShapes);
  return rows;
}

Solved three_quadrics_arrays(Array points, Array planes, int steps, double scale, int threads) {
  const Refining o(steps, scale, threads);
  const Leading leading(points, {0, 3});
  leading.must_equal(Leading(planes, {0, 4}));
  const int rows = rows_of(points, planes, leading, scale > 0 ? 6 : 7);
  const double *x = points.data(), *p = planes.data();
  return solve_batch(leading, 8, [&](BatchOut out) {
    three_quadrics_batch(x, p, leading.size, rows, o.scale, o.policy(), o.threads, out);
    refine_rows<8>(o, x, p, leading.size, rows, out);
  });
}

Solved three_points_arrays(Array points, Array places, double scale, int threads) {
  const Refining o(0, scale, threads);
  const Leading leading(points, {3, 3});
  leading.must_equal(Leading(places, {3, 3}));
  return solve_batch(leading, 1, [&](BatchOut out) {
    three_points_batch(points.data(), places.data(), leading.size, o.scale, o.threads, out);
  });
}

Solved two_conics_arrays(Array points, Array planes, int steps, double scale, int threads) {
  const Refining o(steps, scale, threads);
  const Leading leading(points, {0, 3});
  leading.must_equal(Leading(planes, {0, 4}));
  const int rows = rows_of(points, planes, leading, 7);
  const double *x = points.data(), *p = planes.data();
  for (std::size_t i = 0; i < leading.size * rows; ++i)
    require(!(x[3 * i + 2] != 0), "a point of an image has no third coordinate");
  return solve_batch(leading, 4, [&](BatchOut out) {
    two_conics_batch(x, p, leading.size, rows, o.policy(), o.threads, out);
    refine_rows<4>(o, x, p, leading.size, rows, out);
  });
}

Solved paper_two_lines_arrays(Array points, Array segments, int threads) {
  check_threads(threads);
  const Leading leading(points, {4, 3});
  leading.must_equal(Leading(segments, {4, 2, 3}));
  return solve_batch(leading, 8, [&](BatchOut out) {
    in_threads(leading.size, threads, [&](std::size_t begin, std::size_t end) {
      solve_each<8>(begin, end, out, [&](std::size_t b, std::array<Transform, 8>& solutions) {
        std::array<SpacePointOnLine, 4> problem;
        for (int i = 0; i < 4; ++i) {
          const double* x = points.data() + (b * 4 + i) * 3;
          const Line line = line_through(segments.data() + (b * 4 + i) * 6);
          problem[i] = {{x[0], x[1], x[2]}, line.point, line.direction};
        }
        return paper_two_lines(problem, solutions);
      });
    });
  });
}

Solved paper_four_points_arrays(Array points, Array segments, int threads) {
  check_threads(threads);
  const Leading leading(points, {4, 2});
  leading.must_equal(Leading(segments, {4, 2, 3}));
  return solve_batch(leading, 4, [&](BatchOut out) {
    in_threads(leading.size, threads, [&](std::size_t begin, std::size_t end) {
      solve_each<4>(begin, end, out, [&](std::size_t b, std::array<Transform, 4>& solutions) {
        std::array<PointOnLine, 4> problem;
        for (int i = 0; i < 4; ++i) {
          const double* x = points.data() + (b * 4 + i) * 2;
          const Line line = line_through(segments.data() + (b * 4 + i) * 6);
          problem[i] = {{x[0], x[1]}, line.point, line.direction};
        }
        return paper_four_points(problem, solutions);
      });
    });
  });
}

// One solution at most, and the condition of every problem.
std::tuple<Out<double>, nb::object, Out<double>> linear_arrays(Array points, Array planes, bool planar,
                                                               int threads) {
  check_threads(threads);
  const Leading leading(points, {0, 3});
  leading.must_equal(Leading(planes, {0, 4}));
  const std::size_t rows = points.shape(leading.axes);
  if (planes.shape(leading.axes) != rows) throw nb::value_error(kOtherShapes);
  auto* conditions = new double[leading.size];
  auto [matrices, counts] = solve_batch(leading, 1, [&](BatchOut out) {
    in_threads(leading.size, threads, [&](std::size_t begin, std::size_t end) {
      solve_each<1>(begin, end, out, [&](std::size_t b, std::array<Transform, 1>& solutions) {
        return linear_similarity(points.data() + b * rows * 3, planes.data() + b * rows * 4, rows, planar,
                                 solutions[0], conditions[b])
                   ? 1
                   : 0;
      });
    });
  });
  return {std::move(matrices), std::move(counts), adopt(conditions, leading.shape.data(), leading.axes)};
}

}  // namespace

void bind_solvers(nb::module_& m) {
  m.def("kernel", [] { return kernels(kBlock).name; });
  m.def("four_points", &four_points_arrays, "points"_a.noconvert(), "segments"_a.noconvert(), "steps"_a,
        "scale"_a, "threads"_a);
  m.def("two_lines", &two_lines_arrays, "image_segments"_a.noconvert(), "needle_segments"_a.noconvert(),
        "steps"_a, "scale"_a, "threads"_a);
  m.def("three_quadrics", &three_quadrics_arrays, "points"_a.noconvert(), "planes"_a.noconvert(), "steps"_a,
        "scale"_a, "threads"_a);
  m.def("three_points", &three_points_arrays, "points"_a.noconvert(), "places"_a.noconvert(), "scale"_a,
        "threads"_a);
  m.def("two_conics", &two_conics_arrays, "points"_a.noconvert(), "planes"_a.noconvert(), "steps"_a,
        "scale"_a, "threads"_a);
  m.def("paper_two_lines", &paper_two_lines_arrays, "points"_a.noconvert(), "segments"_a.noconvert(),
        "threads"_a);
  m.def("paper_four_points", &paper_four_points_arrays, "points"_a.noconvert(), "segments"_a.noconvert(),
        "threads"_a);
  m.def("linear", &linear_arrays, "points"_a.noconvert(), "planes"_a.noconvert(), "planar"_a, "threads"_a);
}
