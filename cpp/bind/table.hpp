// The rows that an estimate is made from, checked once at the door: nothing behind it looks again.
#pragma once

#include <nanobind/stl/optional.h>

#include <optional>

#include "bind/arrays.hpp"
#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/estimate/table.hpp"

// Points against lines, or points against planes in groups that are one correspondence each. The arrays stay
// alive.
class BoundTable {
 public:
  using Points = In<double, nb::shape<-1, 3>>;
  using Segments = In<double, nb::shape<-1, 2, 3>>;
  using Planes = In<double, nb::shape<-1, 4>>;
  using Codes = std::optional<In<std::int32_t, nb::ndim<1>>>;
  using Factors = std::optional<In<double, nb::ndim<1>>>;
  using First = In<std::int32_t, nb::ndim<1>>;

  static BoundTable of_lines(Points points, Segments segments, Codes sightings, Codes frames, Codes targets,
                             Factors noise_px, Factors noise_mm, int dimension);
  static BoundTable of_planes(Points points, Planes planes, First first);

  int rows() const { return rows_; }
  bool of_points_and_lines() const { return dimension_ != 0; }
  // Each refuses a table of the other kind.
  sonocal::Table lines() const;
  sonocal::Correspondences planes() const;

 private:
  Points points_;
  int rows_ = 0, dimension_ = 0;
  Segments segments_;
  Codes sightings_, frames_, targets_;
  Factors noise_px_, noise_mm_;
  Planes planes_;
  First first_;
};
