#include "bind/table.hpp"

#include <algorithm>
#include <string>

#include "bind/checks.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

void need_length(std::size_t length, std::size_t rows, const char* name) {
  if (length != rows)
    refuse(std::string(name) + " has " + std::to_string(length) + " entries for " + std::to_string(rows) +
           " rows");
}

// Codes that count something from 0, of which there are not more than rows.
const std::int32_t* checked_codes(const BoundTable::Codes& codes, std::size_t rows, const char* name) {
  if (!codes) return nullptr;
  need_length(codes->shape(0), rows, name);
  const auto sound = [&](std::int32_t code) { return code >= 0 && static_cast<std::size_t>(code) < rows; };
  if (!std::all_of(codes->data(), codes->data() + rows, sound))
    refuse(std::string(name) + " holds a number below 0, or not below the number of rows");
  return codes->data();
}

void check_factors(const BoundTable::Factors& factors, std::size_t rows, const char* name) {
  if (!factors) return;
  need_length(factors->shape(0), rows, name);
  const auto sound = [](double factor) { return usable(factor) && factor > 0; };
  if (!std::all_of(factors->data(), factors->data() + rows, sound))
    refuse(std::string(name) + " holds a number that is not positive");
}

void check_sightings(const std::int32_t* codes, std::size_t rows) {
  std::vector<bool> there(rows);
  std::int32_t most = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    there[codes[i]] = true;
    most = std::max(most, codes[i]);
  }
  for (std::int32_t code = 0; code <= most; ++code)
    require(there[code], "sightings are not counted from 0 without a gap");
}

void check_first(const BoundTable::First& first, int rows) {
  const std::size_t size = first.shape(0);
  require(size >= 2 && first.data()[0] == 0 && first.data()[size - 1] == rows,
          "first does not run from 0 to the number of rows");
  for (std::size_t i = 1; i < size; ++i)
    require(first.data()[i] > first.data()[i - 1], "first does not grow from one entry to the next");
}

// Points that span a point, a line or a plane: as many as it takes, and none of them within rounding of the
// others'.
void check_spanning(const double* points, std::int32_t count) {
  require(count >= 1 && count <= 3, "a target is spanned by one, two or three points");
  const Eigen::Map<const Vector3d> first(points), second(points + 3), third(points + 6);
  constexpr double kFlat = 1e-9;  // of the longest side
  const Vector3d along = second - first, aside = third - first;
  require(count < 2 || along.norm() > 0, "a line's two points are one");
  require(count < 3 || cross(along, aside).norm() > kFlat * along.norm() * aside.norm(),
          "a plane's three points are on one line");
}

}  // namespace

BoundTable BoundTable::of_lines(Points points, Segments segments, Codes sightings, Codes frames,
                                Codes targets, Factors noise_px, Factors noise_mm, int dimension) {
  const std::size_t rows = points.shape(0);
  require(dimension == 2 || dimension == 3, "dimension is neither 2 nor 3");
  require(rows > 0 && rows <= kMostRows, "a table has between one row and 2^28");
  need_length(segments.shape(0), rows, "segments");
  check_finite(points.data(), rows * 3, "points");
  check_finite(segments.data(), rows * 6, "segments");
  for (std::size_t i = 0; dimension == 2 && i < rows; ++i)
    require(points.data()[3 * i + 2] == 0, "points of a 2D image have a third coordinate that is not 0");
  for (std::size_t i = 0; i < rows; ++i)
    require(!std::equal(segments.data() + 6 * i, segments.data() + 6 * i + 3, segments.data() + 6 * i + 3),
            "a segment has no length");
  require(dimension == 3 || !sightings, "sightings of several points are of 3D probes");
  if (const std::int32_t* codes = checked_codes(sightings, rows, "sightings")) check_sightings(codes, rows);
  checked_codes(frames, rows, "frames");
  checked_codes(targets, rows, "targets");
  check_factors(noise_px, rows, "noise_px");
  check_factors(noise_mm, rows, "noise_mm");
  BoundTable table;
  table.points_ = points;
  table.rows_ = static_cast<int>(rows);
  table.dimension_ = dimension;
  table.segments_ = segments;
  table.sightings_ = sightings;
  table.frames_ = frames;
  table.targets_ = targets;
  table.noise_px_ = noise_px;
  table.noise_mm_ = noise_mm;
  return table;
}

BoundTable BoundTable::of_planes(Points points, Planes planes, First first) {
  const std::size_t rows = points.shape(0);
  require(rows > 0 && rows <= kMostRows, "a table has between one row and 2^28");
  need_length(planes.shape(0), rows, "planes");
  check_finite(points.data(), rows * 3, "points");
  check_finite(planes.data(), rows * 4, "planes");
  check_first(first, static_cast<int>(rows));
  BoundTable table;
  table.kind_ = Kind::kPlanes;
  table.points_ = points;
  table.rows_ = static_cast<int>(rows);
  table.planes_ = planes;
  table.first_ = first;
  return table;
}

BoundTable BoundTable::of_targets(Points points, First first, Spanning spanning, First spans,
                                  Factors noise_px, Factors noise_mm, Codes targets, int dimension) {
  const std::size_t rows = points.shape(0), count = spanning.shape(0);
  require(dimension == 2 || dimension == 3, "dimension is neither 2 nor 3");
  require(rows > 0 && rows <= kMostRows, "a table has between one row and 2^28");
  check_finite(points.data(), rows * 3, "points");
  for (std::size_t i = 0; dimension == 2 && i < rows; ++i)
    require(points.data()[3 * i + 2] == 0, "points of a 2D image have a third coordinate that is not 0");
  check_first(first, static_cast<int>(rows));
  need_length(first.shape(0) - 1, count, "first");
  need_length(spans.shape(0), count, "spans");
  check_finite(spanning.data(), count * 9, "spanning");
  for (std::size_t c = 0; c < count; ++c) check_spanning(spanning.data() + 9 * c, spans.data()[c]);
  check_factors(noise_px, rows, "noise_px");
  check_factors(noise_mm, count, "noise_mm");
  checked_codes(targets, rows, "targets");
  BoundTable table;
  table.targets_ = targets;
  table.kind_ = Kind::kTargets;
  table.points_ = points;
  table.rows_ = static_cast<int>(rows);
  table.dimension_ = dimension;
  table.first_ = first;
  table.spanning_ = spanning;
  table.spans_ = spans;
  table.noise_px_ = noise_px;
  table.noise_mm_ = noise_mm;
  return table;
}

void BoundTable::need(Kind kind) const {
  constexpr const char* kNames[] = {"lines", "planes", "targets"};
  if (kind_ != kind)
    refuse(std::string("the table is of points and ") + kNames[static_cast<int>(kind_)] +
           ", and this takes points and " + kNames[static_cast<int>(kind)]);
}

Table BoundTable::lines() const {
  need(Kind::kLines);
  const auto data = [](const auto& array) { return array ? array->data() : nullptr; };
  return {points_.data(),
          segments_.data(),
          data(sightings_),
          {data(frames_), data(targets_)},
          {data(noise_px_), data(noise_mm_)},
          rows_,
          dimension_};
}

Correspondences BoundTable::planes() const {
  need(Kind::kPlanes);
  return {points_.data(), planes_.data(), first_.data(), static_cast<int>(first_.shape(0)) - 1};
}

MixedTable BoundTable::targets() const {
  need(Kind::kTargets);
  const auto data = [](const auto& array) { return array ? array->data() : nullptr; };
  return {points_.data(),
          first_.data(),
          spanning_.data(),
          spans_.data(),
          {data(noise_px_), data(noise_mm_)},
          static_cast<int>(first_.shape(0)) - 1,
          dimension_};
}

void bind_table(nb::module_& m) {
  nb::class_<BoundTable>(m, "Table")
      .def_static("of_lines", &BoundTable::of_lines, "points"_a.noconvert(), "segments"_a.noconvert(),
                  "sightings"_a.noconvert().none() = nb::none(), "frames"_a.noconvert().none() = nb::none(),
                  "targets"_a.noconvert().none() = nb::none(), "noise_px"_a.noconvert().none() = nb::none(),
                  "noise_mm"_a.noconvert().none() = nb::none(), nb::kw_only(), "dimension"_a)
      .def_static("of_planes", &BoundTable::of_planes, "points"_a.noconvert(), "planes"_a.noconvert(),
                  "first"_a.noconvert())
      .def_static("of_targets", &BoundTable::of_targets, "points"_a.noconvert(), "first"_a.noconvert(),
                  "spanning"_a.noconvert(), "spans"_a.noconvert(),
                  "noise_px"_a.noconvert().none() = nb::none(), "noise_mm"_a.noconvert().none() = nb::none(),
                  "targets"_a.noconvert().none() = nb::none(), nb::kw_only(), "dimension"_a)
      .def("__len__", &BoundTable::rows);
}
