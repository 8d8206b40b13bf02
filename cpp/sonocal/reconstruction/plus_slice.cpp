#include "sonocal/reconstruction/plus_slice.hpp"

#include <algorithm>

#include "sonocal/reconstruction/plus_rows.hpp"
#include "sonocal/reconstruction/plus_voxels.hpp"

namespace sonocal::plus {
namespace {

// Axes of the image in the volume, in PLUS's numbers.
template <class Number>
struct Axes {
  Number u[3], v[3], origin[3];

  explicit Axes(const double* m) {
    for (int i = 0; i < 3; ++i, m += 4) {
      u[i] = from<Number>(m[0]), v[i] = from<Number>(m[1]), origin[i] = from<Number>(m[3]);
    }
  }
  void row(int y, Number* start) const {
    for (int i = 0; i < 3; ++i) start[i] = origin[i] + v[i] * y;
  }
  void pixel(const Number* start, int x, Number* at) const {
    for (int i = 0; i < 3; ++i) at[i] = start[i] + u[i] * x;
  }
};

template <class Number>
bool rounds_inside(const Volume& volume, const Number* at, int* voxel) {
  for (int i = 0; i < 3; ++i) voxel[i] = round_of(at[i]);
  return inside(volume, voxel, voxel);
}

// The pixels of a row that round into the volume lie together.
template <class Number>
void inside_volume(const Volume& volume, const Axes<Number>& axes, const Number* start, int width, int& from,
                   int& to) {
  Number at[3];
  int voxel[3];
  const auto out = [&](int u) {
    axes.pixel(start, u, at);
    return !rounds_inside(volume, at, voxel);
  };
  for (from = 0; from < width && out(from);) ++from;
  for (to = width - 1; to >= from && out(to);) --to;
}

// Where PLUS reads next. Its nearest neighbours by importance leave a row at the first pixel of importance 0,
// and the rest of the image is read from there on: so are these.
struct Reader {
  const std::uint8_t* pixel;
  const std::uint8_t* importance;

  void skip(int count) {
    pixel += count;
    if (importance != nullptr) importance += count;
  }
  int weight() const { return importance == nullptr ? kPixel : *importance; }
};

// False where the rest of the row is left.
bool give_nearest(const Volume& volume, const int* voxel, Reader& read, Compounding how) {
  const auto index = index_of(volume, voxel[0], voxel[1], voxel[2]);
  std::uint8_t& value = volume.values[index];
  std::uint16_t& weight = volume.weights[index];
  if (how == Compounding::mean) {
    average(value, weight, *read.pixel, kPixel);
  } else if (how == Compounding::importance) {
    const bool full = weight > kNearlyFull;
    if (!full && read.weight() == 0) return false;
    average(value, weight, *read.pixel, read.weight());
    read.pixel += 1;
    read.importance += !full;
    return true;
  } else {
    value = how == Compounding::latest ? *read.pixel : std::max(value, *read.pixel);
    weight = kPixel;
  }
  read.skip(1);
  return true;
}

template <class Number>
void give_run(const Volume& volume, const Axes<Number>& axes, const Number* start, int from, int to,
              const Settings& s, Reader& read) {
  Number at[3];
  int voxel[3];
  for (int u = from; u <= to; ++u) {
    if (*read.pixel < s.rejection) {
      read.skip(1);
      continue;
    }
    axes.pixel(start, u, at);
    if (s.linear) {
      give_linear(volume, at, *read.pixel, read.weight(), s.compounding);
      read.skip(1);
    } else if (rounds_inside(volume, at, voxel) && !give_nearest(volume, voxel, read, s.compounding)) {
      return;
    }
  }
}

template <class Number>
void insert_rows(const Volume& volume, const Image& image, const double* matrix, const Settings& s) {
  const Axes<Number> axes(matrix);
  const Fan fan(s);
  const Rectangle clip = clip_rectangle(s, image.width, image.height);
  Reader read{image.pixels, image.importance};
  for (int v = 0; v < image.height; ++v) {
    Number start[3];
    axes.row(v, start);
    int from, to;
    inside_volume(volume, axes, start, image.width, from, to);
    const Run run = run_of(v, from, to, fan, clip);
    read.skip(std::max(run.from, 0));
    if (run.skips) {
      give_run(volume, axes, start, run.from, run.skip_from - 1, s, read);
      read.skip(run.skip_to - run.skip_from + 1);
      give_run(volume, axes, start, run.skip_to + 1, run.to, s, read);
    } else {
      give_run(volume, axes, start, run.from, run.to, s, read);
    }
    read.skip(image.width - 1 - run.to);
  }
}

// A voxel of the unoptimised code: what the optimised does, but that importance 0 leaves out a pixel and no
// more.
void give_unoptimised(const Volume& volume, const double* at, int pixel, int importance, const Settings& s) {
  int voxel[3];
  if (s.linear) return give_linear(volume, at, pixel, importance, s.compounding);
  if (!rounds_inside(volume, at, voxel)) return;
  const auto index = index_of(volume, voxel[0], voxel[1], voxel[2]);
  std::uint8_t& value = volume.values[index];
  std::uint16_t& weight = volume.weights[index];
  if (s.compounding == Compounding::mean) {
    average(value, weight, pixel, kPixel);
  } else if (s.compounding == Compounding::importance) {
    if (importance != 0 || weight > kNearlyFull) average(value, weight, pixel, importance);
  } else {
    if (s.compounding == Compounding::latest || pixel > value) value = static_cast<std::uint8_t>(pixel);
    weight = static_cast<std::uint16_t>(std::min(weight + kPixel, kFull));
  }
}

void insert_unoptimised(const Volume& volume, const Image& image, const double* m, const Settings& s) {
  const Fan fan(s);
  const Rectangle clip = clip_rectangle(s, image.width, image.height);
  for (int v = clip.low[1]; v <= clip.high[1]; ++v)
    for (int u = clip.low[0]; u <= clip.high[0]; ++u) {
      const std::size_t place = static_cast<std::size_t>(v) * image.width + u;
      if (image.pixels[place] < s.rejection || (fan.on() && !fan.holds(u, v))) continue;
      double at[3];
      for (int i = 0; i < 3; ++i) at[i] = m[4 * i] * u + m[4 * i + 1] * v + m[4 * i + 3];
      give_unoptimised(volume, at, image.pixels[place],
                       image.importance == nullptr ? kPixel : image.importance[place], s);
    }
}

}  // namespace

void insert_slice(const Volume& volume, const Image& image, const double* matrix, const Settings& settings) {
  switch (settings.arithmetic) {
    case Arithmetic::unoptimised:
      return insert_unoptimised(volume, image, matrix, settings);
    case Arithmetic::doubles:
      return insert_rows<double>(volume, image, matrix, settings);
    case Arithmetic::fixed_point:
      return insert_rows<Fixed>(volume, image, matrix, settings);
  }
}

}  // namespace sonocal::plus
