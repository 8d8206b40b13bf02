// What pixel noise and tracking noise make of the residuals of points to points, lines and planes.
#pragma once

#include <vector>

#include "sonocal/estimate/mixed_table.hpp"

namespace sonocal {

class MixedBlocks;

// Chosen sightings as independent rows, as `NoiseModel` has those of points on lines.
//
// A sighting's residuals N' (A x_j - middle) have the covariance
//     px F (x) N' S S' N + mm (shared 1 1' + sum_k t_k t_k') (x) I
// with t_kj = reach_k . (A x_j - middle) and F the points' own factors. Its two terms have common
// eigenvectors: those of N' S S' N across the target, and those of the second over the points that F makes
// alike.
class MixedNoise {
 public:
  using Blocks = MixedBlocks;

  MixedNoise(const MixedRows& rows, std::vector<int> chosen) : rows_(rows), chosen_(std::move(chosen)) {}

  int dimension() const { return rows_.dimension(); }
  const Normalisation& normalisation() const { return rows_.normalisation(); }
  int sightings() const { return static_cast<int>(chosen_.size()); }

 private:
  friend class MixedBlocks;
  const MixedRows& rows_;
  std::vector<int> chosen_;
};

// The independent rows of every n-th sighting, block after block.
class MixedBlocks {
 public:
  MixedBlocks(const MixedNoise& noise, const Transform& at, Variances levels, int step = 1,
              bool /*pulls*/ = true)
      : noise_(noise), at_(at), linear_(at.linear()), levels_(levels), step_(step) {}
  bool next(IndependentBlock& block);  // false: there are no more

 private:
  // One combination of a sighting's points, seen along up to two of its target's normals.
  struct Row {
    Vector3d x, normal[2];
    double h, offset[2], residual[2], weight[2], alpha[2], beta, huber = 1;
    int normals, first_row;
    Vector3d pull, strained;  // of all normals; zero in a combination's second row
  };

  void split(int sighting);
  void put(const Row& row, IndependentBlock& block) const;

  const MixedNoise& noise_;
  const Transform at_;
  const Matrix3d linear_;
  const Variances levels_;
  const std::size_t step_;
  std::size_t next_ = 0;
  std::vector<Row> waiting_;
};

}  // namespace sonocal
