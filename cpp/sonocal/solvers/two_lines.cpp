#include "sonocal/solvers/two_lines.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace sonocal {
namespace {

// Two lines in general position: unit common perpendicular, signed distance along it, its middle.
struct Pair {
  Matrix3d frame;  // columns: the directions' bisectors and the common perpendicular
  double distance;
  Vector3d middle;
};

// Lines parallel, or meeting, to a part in 1e12 have no common perpendicular that is worth the name.
constexpr double kSmallest = 1e-12;

bool analyse(const Line& a, const Line& b, double sign, Pair& out) {
  const Vector3d d = sign * b.direction;
  const Vector3d normal = a.direction.cross(d);
  const double sine2 = normal.squaredNorm();
  if (!(sine2 > kSmallest * kSmallest)) return false;
  const Vector3d between = b.point - a.point;
  const double along_a = between.cross(d).dot(normal) / sine2;
  const double along_b = between.cross(a.direction).dot(normal) / sine2;
  out.frame.col(0) = (a.direction + d).normalized();
  out.frame.col(1) = (a.direction - d).normalized();
  out.frame.col(2) = out.frame.col(0).cross(out.frame.col(1));
  out.distance = between.dot(out.frame.col(2));
  out.middle = 0.5 * (a.point + along_a * a.direction + b.point + along_b * d);
  return out.frame.allFinite() && std::fabs(out.distance) > kSmallest * between.norm();
}

}  // namespace

int two_lines(const std::array<Line, 2>& image, const std::array<Line, 2>& needles,
              std::array<Transform, 2>& solutions) {
  Pair source, target;
  if (!analyse(image[0], image[1], 1.0, source) || !analyse(needles[0], needles[1], 1.0, target)) return 0;
  // Turning one needle round flips the common perpendicular, and with it the sign of s.
  if (target.distance * source.distance < 0 && !analyse(needles[0], needles[1], -1.0, target)) return 0;
  const double scale = target.distance / source.distance;
  if (!(scale > 0) || !std::isfinite(scale)) return 0;
  for (int i = 0; i < 2; ++i) {
    Transform& out = solutions[i];
    out.rotation = target.frame * source.frame.transpose();
    out.scales.setConstant(scale);
    out.translation = target.middle - out.linear() * source.middle;
    if (!out.translation.allFinite()) return 0;
    target.frame.leftCols<2>() *= -1.0;  // half a turn about the common perpendicular
  }
  return 2;
}

}  // namespace sonocal
