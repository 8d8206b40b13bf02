// Image points against lines: the table of sightings in the form that the estimation runs on.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sonocal/normal_equations.hpp"
#include "sonocal/transform.hpp"

namespace sonocal {

// Centre and size of both sides. All estimation runs on coordinates of order one, so that units and
// offsets cannot hurt it:
//     x_normalised = (x - image_centre) / image_size,   y_normalised = (y - centre) / size.
struct Normalisation {
  Vector3d image_centre = Vector3d::Zero();
  double image_size = 1;
  Vector3d centre = Vector3d::Zero();
  double size = 1;

  Transform to_normalised(const Transform& a) const;
  Transform to_original(const Transform& a) const;
};

// A line by the middle of its segment, its direction and half its length, normalised.
struct Needle {
  Vector3d middle;
  Vector3d direction;
  double half_length;
};

// N points against N lines, as structure of arrays: each line is two planes n . y + offset = 0 with
// orthonormal normals, so that the two residuals' squares add up to the squared distance. The arrays given
// must outlive it.
class PointLines {
 public:
  static constexpr int kPlanes = 2;
  using Column = Eigen::Array<double, Eigen::Dynamic, 1>;
  using Columns3 = Eigen::Array<double, Eigen::Dynamic, 3>;

  // points: N x 3 (w = 0 for a 2D probe), row-major, px; segments: N x 6, both end points, row-major, mm.
  PointLines(const double* points, const double* segments, int count, int dimension);

  int size() const { return static_cast<int>(points_.rows()); }
  int dimension() const { return dimension_; }  // 2: all points in the plane w = 0 before normalisation
  const Normalisation& normalisation() const { return normalisation_; }

  Vector3d point(int i) const { return points_.row(i).matrix(); }
  Needle needle(int i) const;
  Vector3d normal(int i, int plane) const { return normals_[plane].row(i).matrix(); }
  double offset(int i, int plane) const { return offsets_[plane][i]; }

  // Squared distance of every mapped point to its line.
  void squared_distances(const Transform& a, Column& out) const;

  // sum_i min(squared distance, limit), given up (returning at least `enough`) once it reaches it.
  double truncated_sum(const Transform& a, double limit, double enough) const;

  // The cost of the rows with squares[i] <= limit, all of weight one: paper section 8.
  NormalEquations geometric_cost(const Column& squares, double limit) const;

 private:
  int dimension_;
  const double* segments_;
  Normalisation normalisation_;
  Columns3 points_;
  Columns3 normals_[kPlanes];
  Column offsets_[kPlanes];
};

}  // namespace sonocal
