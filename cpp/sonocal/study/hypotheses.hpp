// What a method's hypotheses come from, behind one face: the paper's solvers and our own, on samples of a
// table.
#pragma once

#include "sonocal/estimate/point_lines.hpp"
#include "sonocal/estimate/sightings.hpp"
#include "sonocal/robust/consensus.hpp"

namespace sonocal {

enum class Solver {
  kClosedForm,  // four_points (2D), two_lines (3D)
  kFourPoints,  // the paper's 4point2D, section 6.2
  kTwoLines,    // the paper's 2line3D, section 5.3; of a 2D probe, four points in the plane z = k (section 6)
  kLinear,      // the paper's 5point2D (2D, section 6.1), 3line3D (3D, section 5.2)
};

// Hypotheses from samples of sightings: rows of a 2D probe, lines of two points or more of a 3D one, of which
// the first and the last are taken. Transforms are in normalised coordinates; the paper's solvers run on the
// numbers as they are, because the paper does not centre them.
class Hypotheses {
 public:
  static constexpr int kMost = 8;

  Hypotheses(Solver solver, const double* points, const double* segments, const PointLines& rows,
             const Sightings& sightings);

  int units() const { return sightings_.size(); }
  int sample_size() const;
  int solve(const Sample& sample, std::array<Transform, kMost>& out) const;
  // The linear solution of all rows with squares[i] <= limit; false for the other solvers, which take a
  // sample and no more, and where too few rows agree.
  bool solve_all(const PointLines::Column& squares, double limit, Transform& out) const;

 private:
  int closed_form(const Sample& sample, std::array<Transform, kMost>& out) const;
  int paper_four_points(const Sample& sample, std::array<Transform, kMost>& out) const;
  int paper_two_lines(const Sample& sample, std::array<Transform, kMost>& out) const;
  bool linear(const int* rows, int count, Transform& out) const;
  Vector3d image(int row) const { return Eigen::Map<const Vector3d>(points_ + 3 * row); }
  // Up to two rows of each sighting of the sample; returns how many in all.
  int rows_of(const Sample& sample, int* rows) const;

  Solver solver_;
  const double *points_, *segments_;
  const PointLines& rows_;
  const Sightings& sightings_;
};

}  // namespace sonocal
