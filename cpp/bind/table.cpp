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
  table.points_ = points;
  table.rows_ = static_cast<int>(rows);
  table.planes_ = planes;
  table.first_ = first;
  return table;
}

Table BoundTable::lines() const {
  require(dimension_ != 0, "the table is of points and planes, and this takes points and lines");
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
  require(dimension_ == 0, "the table is of points and lines, and this takes points and planes");
  return {points_.data(), planes_.data(), first_.data(), static_cast<int>(first_.shape(0)) - 1};
}

void bind_table(nb::module_& m) {
  nb::class_<BoundTable>(m, "Table")
      .def_static("of_lines", &BoundTable::of_lines, "points"_a.noconvert(), "segments"_a.noconvert(),
                  "sightings"_a.noconvert().none() = nb::none(), "frames"_a.noconvert().none() = nb::none(),
                  "targets"_a.noconvert().none() = nb::none(), "noise_px"_a.noconvert().none() = nb::none(),
                  "noise_mm"_a.noconvert().none() = nb::none(), nb::kw_only(), "dimension"_a)
      .def_static("of_planes", &BoundTable::of_planes, "points"_a.noconvert(), "planes"_a.noconvert(),
                  "first"_a.noconvert())
      .def("__len__", &BoundTable::rows);
}
