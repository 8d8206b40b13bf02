// Where a point, a line or a plane is, in its own frame, and how that can change.
#pragma once

#include <vector>

#include "sonocal/linalg/transform.hpp"

namespace sonocal {

// The columns of `axes` are orthonormal: those at right angles to the target first, then those along it.
struct Place {
  int spans = 1;  // 1: a point, 2: a line, 3: a plane
  Vector3d base = Vector3d::Zero();
  Matrix3d axes = Matrix3d::Identity();

  int normals() const { return 4 - spans; }
  int reaches() const { return spans - 1; }
  // Numbers that say where it is: 3, 4, 3.
  int freedom() const { return normals() + normals() * reaches(); }
  double square(const Vector3d& y) const {
    double sum = 0;
    for (int k = 0; k < normals(); ++k) sum += std::pow(axes.col(k).dot(y - base), 2);
    return sum;
  }
};

// At the origin: a line's direction, a plane's normal; a point has none.
Place place_along(int spans, const Vector3d& direction);
// What one, two or three points span, in rows.
Place place_through(int spans, const double* spanning);

// The change of a residual n_k . (y - base) by the numbers that say where the place is: shifts along the
// normals (first), then turns of each normal towards each reach.
void by_place(const Place& place, const Vector3d& y, int normal, double* row);
Place moved(const Place& place, const double* step);
// The same place, its base next to what was seen of it.
Place based_near(Place place, const Vector3d& seen);

// Fibonacci's: as many directions of the half sphere, evenly.
std::vector<Vector3d> half_sphere(int count);

}  // namespace sonocal
