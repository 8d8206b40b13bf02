// What pixel noise and tracking noise make of the residuals of points to their needles.
#pragma once

#include <cmath>
#include <vector>

#include "sonocal/estimate/point_lines.hpp"
#include "sonocal/estimate/sightings.hpp"

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

// Squared levels in normalised units.
struct Variances {
  double px = 0;
  double mm = 0;
};

inline Variances variances(const Normalisation& n, NoiseLevels levels) {
  return {std::pow(levels.px / n.image_size, 2), std::pow(levels.mm / n.size, 2)};
}

// Rows whose two residuals are independent of each other and of all others' at a transform: residual[k] has
// the variance px alpha[k] + mm beta[k], whose inverse is weight[k].
struct IndependentBlock : Block {
  int residuals = 0;  // two a row, but where a second plane has no weight
  alignas(64) double residual[2][kRows];
  alignas(64) double alpha[2][kRows];
  alignas(64) double beta[2][kRows];
  alignas(64) double huber[kRows];  // sightings that are too far off count less by this
  int first_row[kRows];             // the table's first row of the sighting

  // Of sum r^2 / v half the derivative through the variances v, by S x + h t of every row, and by the columns
  // of S besides. A fit that leaves it out takes noise in a needle's direction, and of needles through a
  // narrow port noise of any kind, for a reason to shrink.
  alignas(64) double pull[3][kRows];
  Vector3d column_pull[3];
};

class NoiseBlocks;

// Sightings as independent rows.
//
// A point at the place tau of its needle (-1 and 1 at the segment's ends) sees the noise of both ends,
// interpolated or extrapolated, with variance (1 + tau^2) / 2, and two points of one needle share it, with
// covariance (1 + tau_j tau_k) / 2. Pixel noise comes through A, in 2D within the image plane only. An eigen
// decomposition (over a 3D needle's points, of the matrix (1 + tau_j tau_k) / 2; across a 2D needle, of the
// pixel noise seen there) makes the residuals independent whatever the two levels are.
class NoiseModel {
 public:
  using Blocks = NoiseBlocks;
  enum class Kind {
    kAlike,     // every residual has the variance of the tracking level
    kPhysical,  // the above
  };

  // Of the rows with squares[row] <= limit.
  NoiseModel(const PointLines& rows, const Sightings& sightings, RowNoise noise,
             const PointLines::Column& squares, double limit, Kind kind = Kind::kPhysical);

  int dimension() const { return rows_.dimension(); }
  const Normalisation& normalisation() const { return rows_.normalisation(); }
  int sightings() const { return static_cast<int>(singles_.size() + pairs_.size() + others_.size()); }

 private:
  friend class NoiseBlocks;
  struct Single {
    int row, first_row;
  };
  struct Pair {
    int row[2], first_row;
  };
  struct Other {
    std::vector<int> rows;
    int first_row;
  };

  void copy_row(int row, int to, IndependentBlock& block) const;
  double px_factor(int row) const { return noise_.px ? noise_.px[row] : 1.0; }
  double mm_factor(int row) const { return noise_.mm ? noise_.mm[row] : 1.0; }

  const PointLines& rows_;
  RowNoise noise_;
  Kind kind_;
  std::vector<Single> singles_;  // points of a 2D probe
  std::vector<Pair> pairs_;      // two points of a 3D probe's needle
  std::vector<Other> others_;    // any other number of them
};

// The independent rows of every n-th sighting, block after block.
class NoiseBlocks {
 public:
  // pulls: of points of a 2D probe, too.
  NoiseBlocks(const NoiseModel& model, const Transform& at, Variances levels, int step = 1,
              bool pulls = false)
      : model_(model), at_(at), levels_(levels), step_(step), pulls_(pulls) {}
  bool next(IndependentBlock& block);  // false: there are no more

 private:
  void take_singles(IndependentBlock& block);
  void take_pairs(IndependentBlock& block);
  void take_others(IndependentBlock& block);
  void split(const NoiseModel::Other& sighting);

  // Of one needle's points, independent of its other combinations.
  struct Combination {
    Vector3d x;
    double h, beta, by_place, huber;  // by_place: derivative of beta by where it is along the needle
    int row, first_row;
  };

  const NoiseModel& model_;
  const Transform at_;
  const Variances levels_;
  const std::size_t step_;
  const bool pulls_;
  std::size_t single_ = 0, pair_ = 0, other_ = 0;
  std::vector<Combination> waiting_;
};

}  // namespace sonocal
