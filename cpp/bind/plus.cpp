// Volumes as PLUS makes them.
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <array>
#include <optional>

#include "bind/volumes.hpp"
#include "sonocal/reconstruction/plus_slice.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using Values = InOut<std::uint8_t, nb::shape<-1, -1, -1>>;
using Weights = InOut<std::uint16_t, nb::shape<-1, -1, -1>>;
using Image2 = In<std::uint8_t, nb::shape<-1, -1>>;
using Pair = std::array<double, 2>;

// In fixed point a number stays below 2^17.
constexpr double kMostPlusVoxels = 1 << 15;

plus::Volume volume_of(const Values& values, const Weights& weights) {
  plus::Volume volume{values.data(), weights.data(), {}};
  for (int i = 0; i < 3; ++i) {
    require(values.shape(i) == weights.shape(i), "values and weights differ in shape");
    require(values.shape(i) >= 1 && values.shape(i) <= kMostSide,
            "a volume has between 1 and 2^14 voxels along each axis");
    volume.size[2 - i] = static_cast<int>(values.shape(i));
  }
  return volume;
}

plus::Compounding plus_compounding(const std::string& name) {
  if (name == "MEAN") return plus::Compounding::mean;
  if (name == "IMPORTANCE_MASK") return plus::Compounding::importance;
  if (name == "MAXIMUM") return plus::Compounding::maximum;
  require(name == "LATEST", "compounding is not MEAN, IMPORTANCE_MASK, MAXIMUM or LATEST");
  return plus::Compounding::latest;
}

plus::Arithmetic arithmetic_of(const std::string& name) {
  if (name == "NONE") return plus::Arithmetic::unoptimised;
  if (name == "PARTIAL") return plus::Arithmetic::doubles;
  require(name == "FULL", "optimization is not NONE, PARTIAL or FULL");
  return plus::Arithmetic::fixed_point;
}

void check_matrix(const double* m, std::size_t width, std::size_t height) {
  for (int i = 0; i < 3; ++i, m += 4) {
    const bool near = std::abs(m[0]) * static_cast<double>(width) < kMostPlusVoxels &&
                      std::abs(m[1]) * static_cast<double>(height) < kMostPlusVoxels &&
                      std::abs(m[3]) < kMostPlusVoxels;
    require(near, "the image lies further than 2^15 voxels from the volume");
  }
}

void copy(const Pair& from, double* to, double most, const char* otherwise) {
  for (int i = 0; i < 2; ++i) {
    require(std::abs(from[i]) <= most, otherwise);
    to[i] = from[i];
  }
}

void insert(Values values, Weights weights, Image2 image, In<double, nb::shape<3, 4>> matrix,
            std::optional<Image2> importance, const std::string& compounding, const std::string& optimization,
            bool linear, const Pair& clip_origin, const Pair& clip_size, const Pair& fan_angles_deg,
            const Pair& fan_origin, const Pair& fan_radii, double rejection) {
  const plus::Volume volume = volume_of(values, weights);
  check_image(image.shape(0), image.shape(1));
  check_matrix(matrix.data(), image.shape(1), image.shape(0));
  plus::Settings s{
      plus_compounding(compounding), arithmetic_of(optimization), linear, {}, {}, {}, {}, {}, rejection};
  const double far = 1 << 20;
  copy(clip_origin, s.clip_origin, far, "the clip rectangle is further than 2^20 px away");
  copy(clip_size, s.clip_size, far, "the clip rectangle is further than 2^20 px away");
  copy(fan_angles_deg, s.fan_angles_deg, 89, "the fan is wider than 89 degrees to a side");
  copy(fan_origin, s.fan_origin, far, "the fan is further than 2^20 px away");
  copy(fan_radii, s.fan_radii, far, "the fan is further than 2^20 px away");
  require(!std::isnan(rejection), "the threshold is not a number");
  require((s.compounding == plus::Compounding::importance) == importance.has_value(),
          "an importance mask goes with IMPORTANCE_MASK, and with it alone");
  if (importance)
    require(importance->shape(0) == image.shape(0) && importance->shape(1) == image.shape(1),
            "the image and its importance differ in shape");
  const plus::Image one{image.data(), importance ? importance->data() : nullptr,
                        static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0))};
  nb::gil_scoped_release unlocked;
  plus::insert_slice(volume, one, matrix.data(), s);
}

void sticks(Values values, Weights weights, int limit, int most, Values filled) {
  const plus::Volume volume = volume_of(values, weights);
  require(filled.size() == values.size(), "the arrays differ in size");
  require(filled.data() != values.data(), "holes are filled into another array");
  require(limit >= 0 && limit <= 1 << 14 && most >= 0 && most <= 1 << 14, "sticks are between 0 and 2^14");
  nb::gil_scoped_release unlocked;
  plus::fill_with_sticks(volume, limit, most, filled.data());
}

}  // namespace

void bind_plus(nb::module_& m) {
  m.def("plus_insert", &insert, "values"_a.noconvert(), "weights"_a.noconvert(), "image"_a.noconvert(),
        "matrix"_a.noconvert(), "importance"_a.none(), nb::kw_only(), "compounding"_a, "optimization"_a,
        "linear"_a, "clip_origin"_a, "clip_size"_a, "fan_angles_deg"_a, "fan_origin"_a, "fan_radii"_a,
        "rejection"_a);
  m.def("plus_fill_sticks", &sticks, "values"_a.noconvert(), "weights"_a.noconvert(), "limit"_a, "most"_a,
        "filled"_a.noconvert());
}
