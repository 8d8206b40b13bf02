// Noise-free problems with their truth, for the tests and the micro-benchmark of the core.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "sonocal/robust/random.hpp"
#include "sonocal/solvers/gauss_newton.hpp"

namespace sonocal {

struct Problems {
  int size;
  std::vector<double> points, plane_points, segments;  // (size, 4, 3), (size, 4, 2), (size, 4, 2, 3)
  std::vector<Transform> truth;
};

inline double uniform(Random& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random.next() >> 11) * 0x1p-53;
}

inline Vector3d direction(Random& random) {
  const double z = uniform(random, -1, 1), angle = uniform(random, 0, 2 * M_PI), r = std::sqrt(1 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

// Four points on four lines; in space (not planar), points 0, 1 and 2, 3 share a line.
inline Problems make_problems(bool planar, int size, std::uint64_t seed) {
  Random random(seed);
  Problems out{size, {}, {}, {}, {}};
  for (int b = 0; b < size; ++b) {
    Transform a;
    a.rotation = Eigen::AngleAxisd(uniform(random, 0, M_PI), direction(random)).toRotationMatrix();
    a.scales.setConstant(0.24);
    a.translation = 100 * direction(random);
    Vector3d x[4], y[4];
    for (int i = 0; i < 4; ++i) {
      x[i] = {uniform(random, 0, 500), uniform(random, 0, 500), planar ? 0.0 : uniform(random, 0, 500)};
      y[i] = a.apply(x[i]);
    }
    for (int i = 0; i < 4; ++i) {
      const Vector3d d = planar ? direction(random) : Vector3d(y[i | 1] - y[i & ~1]).normalized();
      const Vector3d first = (planar ? y[i] : y[i & ~1]) - 150 * d, last = first + 400 * d;
      out.points.insert(out.points.end(), x[i].data(), x[i].data() + 3);
      out.plane_points.insert(out.plane_points.end(), x[i].data(), x[i].data() + 2);
      out.segments.insert(out.segments.end(), first.data(), first.data() + 3);
      out.segments.insert(out.segments.end(), last.data(), last.data() + 3);
    }
    out.truth.push_back(a);
  }
  return out;
}

// Both planes of every point's line, eight rows a problem.
inline void point_planes(const Problems& p, int b, PointOnPlane* rows) {
  for (int i = 0; i < 4; ++i) {
    const Eigen::Map<const Vector3d> x(&p.points[(b * 4 + i) * 3]), first(&p.segments[(b * 4 + i) * 6]),
        last(&p.segments[(b * 4 + i) * 6 + 3]);
    planes_of_line(x, first, (last - first).normalized(), rows + 2 * i);
  }
}

}  // namespace sonocal
