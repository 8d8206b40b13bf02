// Image points against lines: the table of sightings in the form that the estimation runs on.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sonocal/estimate/normal_equations.hpp"
#include "sonocal/linalg/transform.hpp"

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

// The tangent's map from normalised to original coordinates: the rotation turns about the image's
// centre there and about its origin here, so a turn and a growth move the origin too.
template <int kParameters>
Eigen::Matrix<double, kParameters, kParameters> tangent_to_original(const Transform& original,
                                                                    const Normalisation& normalisation) {
  const Matrix3d s = original.linear();
  const Vector3d centre = normalisation.image_centre;
  Eigen::Matrix<double, kParameters, kParameters> map;
  map.setIdentity();
  map.template block<3, 3>(3, 0) = cross_matrix(s * centre);
  map.template block<3, 3>(3, 3) *= normalisation.size;
  if constexpr (kParameters == 7)
    map.template block<3, 1>(3, 6) = -s * centre;
  else
    for (int axis = 0; axis < kParameters - 6; ++axis)
      map.template block<3, 1>(3, 6 + axis) = -s.col(axis) * centre[axis];
  return map;
}

// Its inverse.
template <int kParameters>
Eigen::Matrix<double, kParameters, kParameters> tangent_to_normalised(const Transform& original,
                                                                      const Normalisation& normalisation) {
  Eigen::Matrix<double, kParameters, kParameters> map =
      tangent_to_original<kParameters>(original, normalisation);
  const double size = normalisation.size;
  map.template block<3, 3>(3, 0) /= -size;
  map.template block<3, 3>(3, 3) /= size * size;
  map.template block<3, kParameters - 6>(3, 6) /= -size;
  return map;
}

// N points against N lines, as structure of arrays: each line is two planes n . y + offset = 0 with
// orthonormal normals, so that the two residuals' squares add up to the squared distance. The line's
// direction is the normals' cross product.
class PointLines {
 public:
  static constexpr int kPlanes = 2;
  // Columns are filled up to a multiple of this with rows that are on their lines wherever they are mapped.
  static constexpr int kPadding = 16;
  using Column = Eigen::Array<double, Eigen::Dynamic, 1>;
  using Columns3 = Eigen::Array<double, Eigen::Dynamic, 3>;

  // points: N x 3 (w = 0 for a 2D probe), row-major, px; segments: N x 6, both end points, row-major, mm.
  PointLines(const double* points, const double* segments, int count, int dimension);

  int size() const { return size_; }
  int dimension() const { return dimension_; }  // 2: all points in the plane w = 0 before normalisation
  const Normalisation& normalisation() const { return normalisation_; }

  Vector3d point(int i) const { return points_.row(i).matrix(); }
  Vector3d normal(int i, int plane) const { return normals_[plane].row(i).matrix(); }
  double offset(int i, int plane) const { return offsets_[plane][i]; }
  // A line by the point of it that is nearest to the origin, and its direction.
  Vector3d direction(int i) const { return cross(normal(i, 0), normal(i, 1)); }
  Vector3d foot(int i) const { return -(offset(i, 0) * normal(i, 0) + offset(i, 1) * normal(i, 1)); }

  // Where a segment's middle is along its direction, and half its length.
  double middle(int i) const { return middles_[i]; }
  double half_length(int i) const { return half_lengths_[i]; }

  // Squared distance of every mapped point to its line.
  void squared_distances(const Transform& a, Column& out) const;

  // sum_i min(squared distance, limit), given up (returning at least `enough`) once it reaches it.
  double truncated_sum(const Transform& a, double limit, double enough) const;

  // The cost of the rows with squares[i] <= limit, all of weight one: paper section 8.
  NormalEquations geometric_cost(const Column& squares, double limit) const;

 private:
  int size_, dimension_;
  Normalisation normalisation_;
  Columns3 points_;
  Columns3 normals_[kPlanes];
  Column offsets_[kPlanes];
  Column middles_, half_lengths_;
};

}  // namespace sonocal
