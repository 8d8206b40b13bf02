// Blobs of an image, as an array.
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <functional>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/detection/blob_filter.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

constexpr std::size_t kColumns = 9;
constexpr float kBrightest = 1e30f;
constexpr int kMostPixels = 1 << 14, kMostBlobs = 1 << 24;
constexpr std::size_t kMostScales = 64;
constexpr double kLeastScale = 0.1, kLargestScale = 1000;

Out<double> detect(BlobFilter& filter, In<float, nb::shape<-1, -1>> image, int count, double least_score,
                   double least_contrast, double level, double split, bool first_echo) {
  if (static_cast<int>(image.shape(0)) != filter.rows() || static_cast<int>(image.shape(1)) != filter.cols())
    refuse("the image and the mask differ in shape");
  require(count >= 0 && count <= kMostBlobs, "count is not between 0 and 2^24");
  const auto finite = [](float x) { return std::abs(x) <= kBrightest; };
  require(std::all_of(image.data(), image.data() + image.size(), finite),
          "the image holds a number that is not finite");
  require(usable(least_score) && usable(least_contrast) && usable(level) && usable(split),
          "a limit is not a finite number");
  std::vector<Blob> blobs;
  {
    nb::gil_scoped_release unlocked;
    blobs = filter.detect(image.data(), {count, least_score, least_contrast, level, split, first_echo});
  }
  std::vector<double> values;
  for (const Blob& b : blobs)
    values.insert(values.end(), {b.u, b.v, b.score, b.scale, b.contrast, b.uu, b.uv, b.vv, b.area});
  return make_array(std::move(values), {blobs.size(), kColumns});
}

void check_filter(std::size_t rows, std::size_t cols, const std::vector<double>& scales, int pool) {
  require(rows > 0 && cols > 0 && rows <= kMostPixels && cols <= kMostPixels,
          "the mask has between one and 2^14 rows and columns");
  require(pool >= 1 && pool <= kMostPixels, "pool is not between 1 and 2^14");
  require(scales.size() >= 2 && scales.size() <= kMostScales, "there are not between 2 and 64 scales");
  for (double scale : scales)
    require(scale >= kLeastScale && scale <= kLargestScale, "a scale is not between 0.1 and 1000 px");
  require(std::is_sorted(scales.begin(), scales.end(), std::less_equal<double>()), "scales do not grow");
}

}  // namespace

void bind_detection(nb::module_& m) {
  nb::class_<BlobFilter>(m, "BlobFilter")
      .def(
          "__init__",
          [](BlobFilter* self, In<std::uint8_t, nb::shape<-1, -1>> mask, std::vector<double> scales,
             int pool) {
            check_filter(mask.shape(0), mask.shape(1), scales, pool);
            new (self) BlobFilter(mask.data(), static_cast<int>(mask.shape(0)),
                                  static_cast<int>(mask.shape(1)), std::move(scales), pool);
          },
          "mask"_a.noconvert(), "scales"_a, "pool"_a)
      .def("detect", &detect, "image"_a.noconvert(), "count"_a, "least_score"_a, "least_contrast"_a,
           "level"_a, "split"_a, "first_echo"_a);
}
