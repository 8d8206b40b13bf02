// The rows that an estimate is made from, checked once at the door: nothing behind it looks again.
#pragma once

#include <nanobind/stl/optional.h>

#include <optional>

#include "bind/arrays.hpp"
#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/estimate/mixed_table.hpp"
#include "sonocal/estimate/table.hpp"

// Points against lines, points against planes in groups that are one correspondence each, or points against
// what other points span. The arrays stay alive.
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
  using Spanning = In<double, nb::shape<-1, 3, 3>>;

  static BoundTable of_planes(Points points, Planes planes, First first);

  static BoundTable of_targets(Points points, First first, Spanning spanning, First spans, Factors noise_px,
                               Factors noise_mm, Codes targets, int dimension);

  int rows() const { return rows_; }
  int dimension() const { return dimension_; }
  bool of_points_and_lines() const { return kind_ == Kind::kLines; }
  bool of_points_and_targets() const { return kind_ == Kind::kTargets; }
  // Which target each point is of, from 0 on; null where nobody said so.
  const std::int32_t* target_codes() const { return targets_ ? targets_->data() : nullptr; }
  // Each refuses a table of the other kind.
  sonocal::Table lines() const;
  sonocal::Correspondences planes() const;
  sonocal::MixedTable targets() const;

 private:
  enum class Kind { kLines, kPlanes, kTargets };
  void need(Kind kind) const;

  Kind kind_ = Kind::kLines;
  Points points_;
  int rows_ = 0, dimension_ = 0;
  Segments segments_;
  Codes sightings_, frames_, targets_;
  Factors noise_px_, noise_mm_;
  Planes planes_;
  First first_, spans_;
  Spanning spanning_;
};
