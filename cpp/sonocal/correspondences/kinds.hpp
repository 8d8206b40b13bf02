// Kinds of correspondences: what one of each kind looks like as rows, and what it is worth in a sample.
#pragma once

#include <vector>

#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/solvers/three_quadrics.hpp"

namespace sonocal {

struct UnitKind {
  std::vector<bool> same_point;  // of each row: whether it has the point of the row before it
  bool line = false;             // two points on a line: its planes are the same pair twice, at right angles
  bool plane = false;            // all points in one plane
  bool point = false;            // one point on a point: three planes at right angles
  std::vector<int> units;  // that are of this kind, in an order that has nothing to do with the given one

  int rows() const { return static_cast<int>(same_point.size()); }
  int points() const;
  // Motions that one more in a sample holds. Of planes on planes, three rows each, the first two leave two
  // rows to say the same (their angle): three of them leave a growth, four hold all.
  int held() const { return plane && rows() > 2 ? 2 : rows(); }
};

// At most one kind for each pattern of points and planes; those of the most rows first.
std::vector<UnitKind> kinds_of(const Correspondences& all);

// The line that a correspondence of kind `line` has for its target.
struct TargetLine {
  Vector3d foot, direction;
};
inline TargetLine target_line(const PointOnPlane& a, const PointOnPlane& b) {
  return {-(a.offset * a.normal + b.offset * b.normal), cross(a.normal, b.normal)};
}

// The point that a correspondence of kind `point` has for its target.
inline Vector3d target_point(const PointOnPlane& a, const PointOnPlane& b, const PointOnPlane& c) {
  return -(a.offset * a.normal + b.offset * b.normal + c.offset * c.normal);
}

}  // namespace sonocal
