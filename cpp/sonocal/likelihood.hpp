// Maximum likelihood: every residual weighted by what pixel noise and tracking noise make of it.
#pragma once

#include <vector>

#include "sonocal/observations.hpp"
#include "sonocal/refine.hpp"
#include "sonocal/sightings.hpp"

namespace sonocal {

// Standard deviations along every axis: of an image point, and of a segment's end point.
struct NoiseLevels {
  double px = 0;
  double mm = 0;
};

// Noise of each row as factors of the levels; null where all rows are alike.
struct RowNoise {
  const double* px = nullptr;
  const double* mm = nullptr;
};

// Two residuals that are independent of each other and of all others: a point x with homogeneous
// coordinate h, held to two planes, r_k = n_k . (S x + h t) + h o_k, of variance a alpha_k + b beta_k with
// a, b the squared levels of pixel and tracking noise. Normalised units throughout.
struct IndependentRow {
  Vector3d x;
  double h;
  Vector3d normal[2];
  double offset[2];
  double alpha[2], beta[2];
};

// Visits a sighting as independent rows, at a transform.
//
// A point at the place tau of its needle (-1 and 1 at the segment's ends) sees the noise of both ends,
// interpolated or extrapolated, with variance b (1 + tau^2) / 2, and two points of one needle share it,
// with covariance b (1 + tau_j tau_k) / 2. Pixel noise comes through A, in 2D within the image plane only.
// An eigen decomposition (over a 3D needle's points, of the matrix (1 + tau_j tau_k) / 2; across a 2D
// needle, of the pixel noise seen there) makes the residuals independent whatever the two levels are.
class NoiseModel {
 public:
  NoiseModel(const PointLines& rows, const Sightings& sightings, RowNoise noise)
      : rows_(rows), sightings_(sightings), noise_(noise) {}

  const PointLines& rows() const { return rows_; }
  int size() const { return sightings_.size(); }
  Sightings::Range sighting(int i) const { return sightings_[i]; }

  // The rows of sighting i with squares[row] <= limit as independent rows, in `out`.
  void independent_rows(int i, const Transform& a, const PointLines::Column& squares, double limit,
                        std::vector<IndependentRow>& out) const;
  // The same rows as they are, for the cost that takes all distances alike.
  void alike_rows(int i, const PointLines::Column& squares, double limit,
                  std::vector<IndependentRow>& out) const;

 private:
  IndependentRow across_needle(int row, const Transform& a) const;
  void along_needle(const std::vector<int>& rows, const Transform& a, std::vector<IndependentRow>& out) const;

  const PointLines& rows_;
  const Sightings& sightings_;
  RowNoise noise_;
};

struct LikelihoodFit {
  Transform transform;
  NoiseLevels levels;         // px, mm
  TangentMatrix information;  // J' V^-1 J at the transform, normalised tangent
  bool converged = false;
};

// From a start to the maximum of the likelihood over the rows with squares[row] <= limit. A level that is
// zero is estimated, by restricted maximum likelihood; one that is not is taken as known.
LikelihoodFit maximise_likelihood(const NoiseModel& noise, const PointLines::Column& squares, double limit,
                                  const Transform& start, Model model, NoiseLevels known);

// Derivative (k) of a residual by the tangent.
template <int kParameters>
Eigen::Matrix<double, kParameters, 1> residual_jacobian(const IndependentRow& row, int plane,
                                                        const Matrix3d& s) {
  Eigen::Matrix<double, kParameters, 1> j;
  const Vector3d sx = s * row.x;
  const Vector3d& n = row.normal[plane];
  j[0] = sx.y() * n.z() - sx.z() * n.y();
  j[1] = sx.z() * n.x() - sx.x() * n.z();
  j[2] = sx.x() * n.y() - sx.y() * n.x();
  j.template segment<3>(3) = row.h * n;
  if (kParameters == 7) {
    j[6] = n.dot(sx);
  } else {
    j[6] = n.dot(s.col(0)) * row.x[0];
    j[kParameters - 1] = n.dot(s.col(1)) * row.x[1];
  }
  return j;
}

inline double residual(const IndependentRow& row, int plane, const Matrix3d& s, const Vector3d& t) {
  return row.normal[plane].dot(s * row.x + row.h * t) + row.h * row.offset[plane];
}

}  // namespace sonocal
