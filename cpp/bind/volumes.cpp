// Images put into the voxels of a box; the arrays that they are added up in are Python's.
#include "bind/volumes.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>

#include "sonocal/reconstruction/averages.hpp"
#include "sonocal/reconstruction/between.hpp"
#include "sonocal/reconstruction/slices.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

template <class Pixel>
using Images = In<Pixel, nb::shape<-1, -1, -1>>;
using Which = In<std::int32_t, nb::shape<-1>>;
using Spans = In<std::int32_t, nb::shape<-1, 3>>;
using Cells = InOut<std::uint64_t, nb::shape<-1, -1, -1>>;
using Sums = InOut<double, nb::shape<-1, -1, -1, 2>>;

Compounding compounding_of(const std::string& name) {
  if (name == "mean") return Compounding::mean;
  if (name == "maximum") return Compounding::maximum;
  require(name == "latest", "compounding is not mean, maximum or latest");
  return Compounding::latest;
}

std::vector<Span> spans_of(const Spans& spans, std::size_t height, std::size_t width) {
  std::vector<Span> found;
  for (const std::int32_t* s = spans.data(); s != spans.data() + spans.size(); s += 3) {
    require(s[0] >= 0 && s[0] < static_cast<std::int64_t>(height) && s[1] >= 0 && s[1] <= s[2] &&
                s[2] <= static_cast<std::int64_t>(width),
            "a span does not lie in the image");
    found.push_back({s[0], s[1], s[2]});
  }
  return found;
}

void check_matrices(const Matrices& matrices, std::size_t count) {
  require(matrices.shape(0) == count, "there are not as many matrices as images");
  check_finite(matrices.data(), matrices.size(), "matrices");
}

template <class Pixel>
Slices<Pixel> slices_of(const Images<Pixel>& images, const Matrices& matrices, const Which& which,
                        const std::vector<Span>& spans) {
  check_image(images.shape(1), images.shape(2));
  check_matrices(matrices, images.shape(0));
  for (std::size_t i = 0; i < which.size(); ++i)
    require(which.data()[i] >= 0 && static_cast<std::size_t>(which.data()[i]) < images.shape(0),
            "which names an image that is not there");
  return {images.data(),
          matrices.data(),
          which.data(),
          which.size(),
          static_cast<int>(images.shape(2)),
          static_cast<int>(images.shape(1)),
          spans.data(),
          spans.size()};
}

template <class Pixel>
void nearest(Cells cells, Low low, Images<Pixel> images, Matrices matrices, Which which, Spans spans,
             const std::string& compounding) {
  const Box box = box_of(low, cells.shape(0), cells.shape(1), cells.shape(2), 0);
  const std::vector<Span> rows = spans_of(spans, images.shape(1), images.shape(2));
  const Slices<Pixel> slices = slices_of(images, matrices, which, rows);
  const Compounding how = compounding_of(compounding);
  nb::gil_scoped_release unlocked;
  insert_nearest(slices, box, how, cells.data());
}

template <class Pixel>
void linear(Sums sums, Low low, Images<Pixel> images, Matrices matrices, Which which, Spans spans) {
  const Box box = box_of(low, sums.shape(0), sums.shape(1), sums.shape(2), 1);
  const std::vector<Span> rows = spans_of(spans, images.shape(1), images.shape(2));
  const Slices<Pixel> slices = slices_of(images, matrices, which, rows);
  nb::gil_scoped_release unlocked;
  insert_linear(slices, box, sums.data());
}

template <class Pixel>
Passage<Pixel> passage_of(const Images<Pixel>& images, const Matrices& matrices, const Which& joined,
                          const In<std::uint8_t, nb::shape<-1, -1>>& mask, std::vector<std::uint8_t>& flags) {
  check_image(images.shape(1), images.shape(2));
  check_matrices(matrices, images.shape(0));
  require(images.shape(0) >= 1 && joined.size() + 1 == images.shape(0),
          "joined has not one entry less than there are images");
  require(mask.shape(0) == images.shape(1) && mask.shape(1) == images.shape(2),
          "the images and the mask differ in shape");
  flags.assign(joined.data(), joined.data() + joined.size());
  return {images.data(),
          matrices.data(),
          flags.data(),
          images.shape(0),
          static_cast<int>(images.shape(2)),
          static_cast<int>(images.shape(1)),
          mask.data()};
}

template <class Pixel>
void between(Cells cells, Low low, Images<Pixel> images, Matrices matrices, Which joined,
             In<std::uint8_t, nb::shape<-1, -1>> mask, const std::string& compounding) {
  const Box box = box_of(low, cells.shape(0), cells.shape(1), cells.shape(2), 0);
  std::vector<std::uint8_t> flags;
  const Passage<Pixel> passage = passage_of(images, matrices, joined, mask, flags);
  const Compounding how = compounding_of(compounding);
  nb::gil_scoped_release unlocked;
  insert_between(passage, box, how, cells.data());
}

template <class Pixel>
void alone(Cells cells, Low low, Images<Pixel> images, Matrices matrices, Which joined,
           In<std::uint8_t, nb::shape<-1, -1>> mask, const std::string& compounding, double half_mm,
           bool first, bool last) {
  const Box box = box_of(low, cells.shape(0), cells.shape(1), cells.shape(2), 0);
  require(half_mm >= 0 && usable(half_mm), "half_mm is not a length");
  std::vector<std::uint8_t> flags;
  const Passage<Pixel> passage = passage_of(images, matrices, joined, mask, flags);
  const Compounding how = compounding_of(compounding);
  nb::gil_scoped_release unlocked;
  insert_alone(passage, box, half_mm, first, last, how, cells.data());
}

// Over so many pixels sums are below 2^32.
constexpr int kMostAcross = 127;

template <class Pixel>
void average(In<Pixel, nb::shape<-1, -1>> image, int across, int down,
             InOut<Pixel, nb::shape<-1, -1>> averaged) {
  check_image(image.shape(0), image.shape(1));
  require(averaged.shape(0) == image.shape(0) && averaged.shape(1) == image.shape(1),
          "the arrays differ in shape");
  require(averaged.data() != image.data(), "an image is averaged into another array");
  require(across >= 1 && across <= kMostAcross && down >= 1 && down <= kMostAcross,
          "an average is over 1 to 127 pixels along each side");
  nb::gil_scoped_release unlocked;
  average_image(image.data(), static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0)), across,
                down, averaged.data());
}

// Values of the box, and how often each voxel was given one.
template <class Pixel>
void settle_of_cells(Cells cells, const std::string& compounding, std::uint64_t parts,
                     InOut<Pixel, nb::shape<-1, -1, -1>> values,
                     InOut<std::uint32_t, nb::shape<-1, -1, -1>> counts) {
  require(values.size() == cells.size() && counts.size() == cells.size(), "the arrays differ in size");
  require(parts == 1 || parts == kGreyParts, "parts of a grey level are 1 or 256");
  const Compounding how = compounding_of(compounding);
  nb::gil_scoped_release unlocked;
  settle_cells(cells.data(), cells.size(), how, parts, values.data(), counts.data());
}

template <class Pixel>
void settle_of_sums(Sums sums, InOut<Pixel, nb::shape<-1, -1, -1>> values,
                    InOut<std::uint32_t, nb::shape<-1, -1, -1>> counts) {
  for (int i = 0; i < 3; ++i)
    require(values.shape(i) + 2 == sums.shape(i) && counts.shape(i) == values.shape(i),
            "the arrays differ in size");
  Box box{{0, 0, 0}, {}};
  for (int i = 0; i < 3; ++i) box.size[i] = static_cast<int>(values.shape(2 - i));
  nb::gil_scoped_release unlocked;
  settle_sums(sums.data(), box, values.data(), counts.data());
}

template <class Pixel>
void bind_pixels(nb::module_& m) {
  m.def("insert_nearest", &nearest<Pixel>, "cells"_a.noconvert(), "low"_a.noconvert(), "images"_a.noconvert(),
        "matrices"_a.noconvert(), "which"_a.noconvert(), "spans"_a.noconvert(), "compounding"_a);
  m.def("insert_linear", &linear<Pixel>, "sums"_a.noconvert(), "low"_a.noconvert(), "images"_a.noconvert(),
        "matrices"_a.noconvert(), "which"_a.noconvert(), "spans"_a.noconvert());
  m.def("insert_between", &between<Pixel>, "cells"_a.noconvert(), "low"_a.noconvert(), "images"_a.noconvert(),
        "matrices"_a.noconvert(), "joined"_a.noconvert(), "mask"_a.noconvert(), "compounding"_a);
  m.def("insert_alone", &alone<Pixel>, "cells"_a.noconvert(), "low"_a.noconvert(), "images"_a.noconvert(),
        "matrices"_a.noconvert(), "joined"_a.noconvert(), "mask"_a.noconvert(), "compounding"_a, "half_mm"_a,
        "first"_a, "last"_a);
  m.def("average_image", &average<Pixel>, "image"_a.noconvert(), "across"_a, "down"_a,
        "averaged"_a.noconvert());
  m.def("settle_cells", &settle_of_cells<Pixel>, "cells"_a.noconvert(), "compounding"_a, "parts"_a,
        "values"_a.noconvert(), "counts"_a.noconvert());
  m.def("settle_sums", &settle_of_sums<Pixel>, "sums"_a.noconvert(), "values"_a.noconvert(),
        "counts"_a.noconvert());
}

}  // namespace

void bind_volumes(nb::module_& m) {
  bind_pixels<std::uint8_t>(m);
  bind_pixels<std::uint16_t>(m);
}
