#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/reconstruction/slices.hpp"

namespace sonocal {
namespace {

// Where a pixel of a row lies in the box, and how it goes on: numbers of its own, since cells might be the
// row's.
struct Runner {
  std::int64_t x, y, z;
  const std::int64_t along, down, off, wide, deep;

  Runner(const PixelRow& row, const Box& box, int u)
      : x(row.at[0] + u * row.step[0] - box.lo[0] * kOneVoxel),
        y(row.at[1] + u * row.step[1] - box.lo[1] * kOneVoxel),
        z(row.at[2] + u * row.step[2] - box.lo[2] * kOneVoxel),
        along(row.step[0]),
        down(row.step[1]),
        off(row.step[2]),
        wide(box.size[0]),
        deep(wide * box.size[1]) {}

  std::int64_t next() {
    const std::int64_t cell = (x >> kFraction) + (y >> kFraction) * wide + (z >> kFraction) * deep;
    x += along, y += down, z += off;
    return cell;
  }
};

// Pixels of a row that all lie in the box. A voxel takes several in succession, and each waits for the one
// before: so both halves of the row go at once, where their order has no meaning.
template <Compounding how, class Pixel>
void insert_row(const PixelRow& row, const Box& box, const Pixel* pixels, int first, int last,
                std::uint64_t* cells) {
  if constexpr (how != Compounding::latest) {
    const int half = (last - first) / 2;
    Runner near(row, box, first), far(row, box, first + half);
    for (const int middle = first + half; first < middle; ++first) {
      give<how>(cells[near.next()], pixels[first]);
      give<how>(cells[far.next()], pixels[first + half]);
    }
    first += half;
  }
  Runner rest(row, box, first);
  for (; first < last; ++first) give<how>(cells[rest.next()], pixels[first]);
}

template <Compounding how, class Pixel>
void insert_image(const Slices<Pixel>& s, const double* matrix, const Pixel* image, const Box& box,
                  std::uint64_t* cells) {
  if (!near_enough(matrix, s.width, s.height)) return;
  for (const Span* span = s.spans; span != s.spans + s.span_count; ++span) {
    const PixelRow row = row_of(matrix, span->row, 0.5);
    int first = span->first, last = span->last;
    clip(row, box, first, last);
    insert_row<how>(row, box, image + std::size_t{1} * span->row * s.width, first, last, cells);
  }
}

template <Compounding how, class Pixel>
void insert_images(const Slices<Pixel>& s, const Box& box, std::uint64_t* cells) {
  for (std::size_t i = 0; i < s.count; ++i) {
    allow_interrupt();
    const std::size_t k = s.which[i];
    insert_image<how>(s, s.matrices + 12 * k, s.pixels + k * s.width * s.height, box, cells);
  }
}

}  // namespace

template <class Pixel>
void insert_nearest(const Slices<Pixel>& slices, const Box& box, Compounding how, std::uint64_t* cells) {
  switch (how) {
    case Compounding::mean:
      return insert_images<Compounding::mean>(slices, box, cells);
    case Compounding::maximum:
      return insert_images<Compounding::maximum>(slices, box, cells);
    case Compounding::latest:
      return insert_images<Compounding::latest>(slices, box, cells);
  }
}

template void insert_nearest(const Slices<std::uint8_t>&, const Box&, Compounding, std::uint64_t*);
template void insert_nearest(const Slices<std::uint16_t>&, const Box&, Compounding, std::uint64_t*);

}  // namespace sonocal
