// The two lines of two_lines.hpp, in lanes.
#pragma once

#include "sonocal/solvers/lanes/lanes_io.hpp"

namespace sonocal {
namespace spatial {

template <class T>
struct Lines {
  Vec3<T> point[2], direction[2];  // unit
};

// Two lines in general position: an orthonormal frame of their directions' bisectors and the common
// perpendicular, the signed distance along it, the middle between its feet.
template <class T>
struct Pair {
  Vec3<T> sum, difference, normal;
  T distance;
  Vec3<T> middle;
  Mask<T> valid;
};

// Lines parallel, or meeting, to a part in 1e12 have no common perpendicular that is worth the name.
constexpr double kSmallest = 1e-12;

// Where two lines' common perpendicular meets them, and how long it is.
template <class T>
SONOCAL_INLINE Pair<T> analyse(const Lines<T>& lines) {
  const Vec3<T>&a = lines.direction[0], &b = lines.direction[1];
  const Vec3<T> between = lines.point[1] - lines.point[0], normal = cross(a, b);
  const T sine2 = dot(normal, normal), inverse = 1.0 / sine2, root = sqrt(inverse);
  const T along_a = inverse * dot(cross(between, b), normal);
  const T along_b = inverse * dot(cross(between, a), normal);
  Pair<T> out;
  out.normal = root * normal;
  out.distance = dot(between, out.normal);
  out.middle = broadcast<T>(0.5) * (lines.point[0] + along_a * a + lines.point[1] + along_b * b);
  out.valid = (sine2 > kSmallest * kSmallest) &
              (out.distance * out.distance > kSmallest * kSmallest * dot(between, between));
  return out;
}

// The bisectors, with the second direction turned round where `sign` is negative. They take the normal's
// place in order: sum x difference = -2 a x b.
template <class T>
SONOCAL_INLINE void bisect(const Lines<T>& lines, const T& sign, Pair<T>& pair) {
  const Vec3<T> b = sign * lines.direction[1];
  pair.sum = unit(lines.direction[0] + b);
  pair.normal = -sign * pair.normal;
  pair.distance = -sign * pair.distance;
  pair.difference = cross(pair.normal, pair.sum);
}

template <class T>
SONOCAL_INLINE void solve(const Lines<T>& image, const Lines<T>& needles, Candidate<T> (&out)[2]) {
  Pair<T> source = analyse(image), target = analyse(needles);
  const Mask<T> valid = source.valid & target.valid;
  // Turning one needle round flips the common perpendicular, and with it the sign of s.
  const T one = broadcast<T>(1.0);
  bisect(image, one, source);
  bisect(needles, with_sign(one, source.distance * -target.distance), target);
  const T scale = target.distance / source.distance;
  for (int i = 0; i < 2; ++i) {
    // R = target source^T; then half a turn about the common perpendicular.
    const T sign = broadcast<T>(i == 0 ? 1.0 : -1.0);
    const Vec3<T> sum = sign * target.sum, difference = sign * target.difference;
    Candidate<T>& c = out[i];
    c.column[0] = source.sum.x * sum + source.difference.x * difference + source.normal.x * target.normal;
    c.column[1] = source.sum.y * sum + source.difference.y * difference + source.normal.y * target.normal;
    c.column[2] = source.sum.z * sum + source.difference.z * difference + source.normal.z * target.normal;
    c.scale = scale;
    const Vec3<T>& m = source.middle;
    c.translation = target.middle - scale * (m.x * c.column[0] + m.y * c.column[1] + m.z * c.column[2]);
    c.valid = valid & (scale > 0.0) &
              finite(scale + c.column[0].x + c.translation.x + c.translation.y + c.translation.z);
  }
}

SONOCAL_INLINE Lines<Pack> gather_lines(const double* ends, int problems) {
  Lines<Pack> lines;
  for (int i = 0; i < 2; ++i) {
    lines.point[i] = gather3(ends + 6 * i, 12, problems - 1);
    lines.direction[i] = unit(gather3(ends + 6 * i + 3, 12, problems - 1) - lines.point[i]);
  }
  return lines;
}

}  // namespace spatial

SONOCAL_INLINE void two_lines_range(const double* image, const double* needles, std::size_t size,
                                    BatchOut out) {
  for (std::size_t b = 0; b < size; b += kWidth) {
    const int problems = size - b < kWidth ? static_cast<int>(size - b) : kWidth;
    const BatchOut to{out.matrices + b * 32, out.counts + b};
    Candidate<Pack> candidates[2];
    spatial::solve(spatial::gather_lines(image + b * 12, problems),
                   spatial::gather_lines(needles + b * 12, problems), candidates);
    for (int i = 0; i < problems; ++i) to.counts[i] = 0;
    for (const auto& candidate : candidates) append<2>(candidate, candidate.valid, problems, to);
    fill_rest<2>(problems, to);
  }
}

}  // namespace sonocal
