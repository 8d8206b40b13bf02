#include "sonocal/reconstruction/between.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/interrupt/interrupt.hpp"

namespace sonocal {
namespace {

// A number that changes steadily along a row of voxels.
struct Along {
  double start, step;
  double at(int x) const { return start + step * x; }
};

Along along(const double* row, int y, int z) { return {row[1] * y + row[2] * z + row[3], row[0]}; }

// u, v and w of one image along a row of voxels.
struct Sight {
  Along u, v, w;
};

Sight sight(const double* matrix, int y, int z) {
  return {along(matrix, y, z), along(matrix + 4, y, z), along(matrix + 8, y, z)};
}

// Two images, or one twice, and the place in both.
template <class Pixel>
struct Sampler {
  const Passage<Pixel>& p;

  // In parts of a grey level; false where there is no ultrasound. Weights are whole numbers: the same on all
  // machines.
  bool value(const Pixel* near, const Pixel* far, double u, double v, double t, std::uint64_t& found) const {
    if (!(u >= 0 && v >= 0 && u <= p.width - 1 && v <= p.height - 1)) return false;
    if (p.mask[static_cast<std::size_t>(v + 0.5) * p.width + static_cast<std::size_t>(u + 0.5)] == 0)
      return false;
    const int iu = std::min(static_cast<int>(u), p.width - 2),
              iv = std::min(static_cast<int>(v), p.height - 2);
    const std::uint64_t fu = std::lrint((u - iu) * 256), fv = std::lrint((v - iv) * 256),
                        ft = std::lrint(t * 256);
    const std::size_t at = static_cast<std::size_t>(iv) * p.width + iu;
    const std::uint64_t both = (256 - ft) * corners(near + at, fu, fv) + ft * corners(far + at, fu, fv);
    found = (both + (1 << 15)) >> 16;
    return true;
  }

  std::uint64_t corners(const Pixel* at, std::uint64_t fu, std::uint64_t fv) const {
    return (256 - fv) * ((256 - fu) * at[0] + fu * at[1]) +
           fv * ((256 - fu) * at[p.width] + fu * at[p.width + 1]);
  }
};

// The least box around the places of the image's corners in the volume, grown by a voxel, within another.
Box around(const double* const* matrices, int count, double margin_mm, int width, int height,
           const Box& box) {
  double low[3] = {1e300, 1e300, 1e300}, high[3] = {-1e300, -1e300, -1e300};
  for (int k = 0; k < count; ++k) {
    const double* m = matrices[k];
    const double minors[3][3] = {
        {m[5] * m[10] - m[6] * m[9], m[2] * m[9] - m[1] * m[10], m[1] * m[6] - m[2] * m[5]},
        {m[6] * m[8] - m[4] * m[10], m[0] * m[10] - m[2] * m[8], m[2] * m[4] - m[0] * m[6]},
        {m[4] * m[9] - m[5] * m[8], m[1] * m[8] - m[0] * m[9], m[0] * m[5] - m[1] * m[4]}};
    const double det = m[0] * minors[0][0] + m[1] * minors[1][0] + m[2] * minors[2][0];
    for (int corner = 0; corner < 8; ++corner) {
      const double seen[3] = {(corner & 1 ? width - 1 : 0) - m[3], (corner & 2 ? height - 1 : 0) - m[7],
                              (corner & 4 ? margin_mm : -margin_mm) - m[11]};
      for (int i = 0; i < 3; ++i) {
        const double x = (minors[i][0] * seen[0] + minors[i][1] * seen[1] + minors[i][2] * seen[2]) / det;
        low[i] = std::min(low[i], x), high[i] = std::max(high[i], x);
      }
    }
  }
  Box within;
  for (int i = 0; i < 3; ++i) {
    const double from = std::max(std::floor(low[i]), static_cast<double>(box.lo[i]));
    const double until = std::min(std::ceil(high[i]) + 1, static_cast<double>(box.lo[i]) + box.size[i]);
    const bool some = from < until;  // false for NaN, of a matrix without an inverse
    within.lo[i] = some ? static_cast<int>(from) : box.lo[i];
    within.size[i] = some ? static_cast<int>(until) - within.lo[i] : 0;
  }
  return within;
}

// Calls `visit(x)` for the voxels of [from, until) at which two numbers that change steadily have different
// signs: between their roots, or on both sides of them. What lies near a root is left to the caller, to be
// decided there.
template <class Visit>
void where_signs_differ(const Along& a, const Along& b, int from, int until, const Visit& visit) {
  double roots[2] = {a.step == 0 ? -1e300 : -a.start / a.step, b.step == 0 ? -1e300 : -b.start / b.step};
  if (roots[0] > roots[1]) std::swap(roots[0], roots[1]);
  int x = from;
  for (int piece = 0; piece < 3; ++piece) {
    const double edge = piece == 2 ? until : roots[piece];
    const int end = static_cast<int>(std::clamp(std::floor(edge) + 2, static_cast<double>(x), double(until)));
    const double low = piece == 0 ? from : std::max(roots[piece - 1], double(from));
    const double middle = 0.5 * (low + std::min(edge, static_cast<double>(until)));
    if ((a.start + a.step * middle) * (b.start + b.step * middle) <= 0) {
      for (; x < end; ++x) visit(x);
    } else {  // but for the voxels at its ends
      for (const int near = std::min(x + 2, end); x < near; ++x) visit(x);
      for (x = std::max(x, end - 3); x < end; ++x) visit(x);
    }
  }
}

template <class Visit>
void each_row(const Box& box, const Visit& visit) {
  for (int z = box.lo[2]; z < box.lo[2] + box.size[2]; ++z)
    for (int y = box.lo[1]; y < box.lo[1] + box.size[1]; ++y) visit(y, z);
}

std::uint64_t* row_in(std::uint64_t* cells, const Box& box, int y, int z) {
  return cells + (static_cast<std::size_t>(z - box.lo[2]) * box.size[1] + (y - box.lo[1])) * box.size[0];
}

template <Compounding how, class Pixel>
void insert_pair(const Passage<Pixel>& p, std::size_t k, const Box& box, std::uint64_t* cells) {
  const double* near = p.matrices + 12 * k;
  const double* far = near + 12;
  const double* both[2] = {near, far};
  const Box within = around(both, 2, 0, p.width, p.height, box);
  const std::size_t area = static_cast<std::size_t>(p.width) * p.height;
  const Pixel* image = p.pixels + k * area;
  const Sampler<Pixel> sampler{p};
  each_row(within, [&](int y, int z) {
    const Sight a = sight(near, y, z), b = sight(far, y, z);
    std::uint64_t* row = row_in(cells, box, y, z) - box.lo[0];
    where_signs_differ(a.w, b.w, within.lo[0], within.lo[0] + within.size[0], [&](int x) {
      const double from = a.w.at(x), to = b.w.at(x);
      if (from * to > 0) return;
      const double t = from == to ? 0.5 : from / (from - to);
      const double u = a.u.at(x) + t * (b.u.at(x) - a.u.at(x)), v = a.v.at(x) + t * (b.v.at(x) - a.v.at(x));
      std::uint64_t value;
      if (sampler.value(image, image + area, u, v, t, value)) give<how>(row[x], value);
    });
  });
}

template <Compounding how, class Pixel>
void insert_one(const Passage<Pixel>& p, std::size_t k, const Box& box, double half_mm,
                std::uint64_t* cells) {
  const double* matrix = p.matrices + 12 * k;
  const Box within = around(&matrix, 1, half_mm, p.width, p.height, box);
  const Pixel* image = p.pixels + k * static_cast<std::size_t>(p.width) * p.height;
  const Sampler<Pixel> sampler{p};
  each_row(within, [&](int y, int z) {
    const Sight seen = sight(matrix, y, z);
    std::uint64_t* row = row_in(cells, box, y, z) - box.lo[0];
    const Along above{seen.w.start - half_mm, seen.w.step}, below{seen.w.start + half_mm, seen.w.step};
    where_signs_differ(above, below, within.lo[0], within.lo[0] + within.size[0], [&](int x) {
      std::uint64_t value;
      if (std::abs(seen.w.at(x)) <= half_mm &&
          sampler.value(image, image, seen.u.at(x), seen.v.at(x), 0, value))
        give<how>(row[x], value);
    });
  });
}

}  // namespace

template <class Pixel>
void insert_between(const Passage<Pixel>& p, const Box& box, Compounding how, std::uint64_t* cells) {
  for (std::size_t k = 0; k + 1 < p.count; ++k) {
    allow_interrupt();
    if (p.joined[k] == 0) continue;
    if (how == Compounding::mean) insert_pair<Compounding::mean>(p, k, box, cells);
    if (how == Compounding::maximum) insert_pair<Compounding::maximum>(p, k, box, cells);
    if (how == Compounding::latest) insert_pair<Compounding::latest>(p, k, box, cells);
  }
}

template <class Pixel>
void insert_alone(const Passage<Pixel>& p, const Box& box, double half_mm, bool first, bool last,
                  Compounding how, std::uint64_t* cells) {
  for (std::size_t k = 0; k < p.count; ++k) {
    allow_interrupt();
    const bool before = k == 0 ? first : p.joined[k - 1] != 0;
    const bool after = k + 1 == p.count ? last : p.joined[k] != 0;
    if (before && after) continue;
    if (how == Compounding::mean) insert_one<Compounding::mean>(p, k, box, half_mm, cells);
    if (how == Compounding::maximum) insert_one<Compounding::maximum>(p, k, box, half_mm, cells);
    if (how == Compounding::latest) insert_one<Compounding::latest>(p, k, box, half_mm, cells);
  }
}

template void insert_between(const Passage<std::uint8_t>&, const Box&, Compounding, std::uint64_t*);
template void insert_between(const Passage<std::uint16_t>&, const Box&, Compounding, std::uint64_t*);
template void insert_alone(const Passage<std::uint8_t>&, const Box&, double, bool, bool, Compounding,
                           std::uint64_t*);
template void insert_alone(const Passage<std::uint16_t>&, const Box&, double, bool, bool, Compounding,
                           std::uint64_t*);

}  // namespace sonocal
