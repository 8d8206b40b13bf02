// Blobs of an image, as an array.
#include <nanobind/stl/vector.h>

#include "bind/arrays.hpp"
#include "sonocal/detection/blob_filter.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

constexpr std::size_t kColumns = 9;

Out<double> detect(BlobFilter& filter, In<float, nb::shape<-1, -1>> image, int count, double least_score,
                   double least_contrast, double level, double split, bool first_echo) {
  if (static_cast<int>(image.shape(0)) != filter.rows() || static_cast<int>(image.shape(1)) != filter.cols())
    throw nb::value_error("the image and the mask differ in shape");
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

}  // namespace

void bind_detection(nb::module_& m) {
  nb::class_<BlobFilter>(m, "BlobFilter")
      .def(
          "__init__",
          [](BlobFilter* self, In<std::uint8_t, nb::shape<-1, -1>> mask, std::vector<double> scales,
             int pool) {
            new (self) BlobFilter(mask.data(), static_cast<int>(mask.shape(0)),
                                  static_cast<int>(mask.shape(1)), std::move(scales), pool);
          },
          "mask"_a.noconvert(), "scales"_a, "pool"_a)
      .def("detect", &detect, "image"_a.noconvert(), "count"_a, "least_score"_a, "least_contrast"_a,
           "level"_a, "split"_a, "first_echo"_a);
}
