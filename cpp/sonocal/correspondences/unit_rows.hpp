// The rows of correspondences in the form that consensus runs on: those of one kind side by side.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sonocal/correspondences/kinds.hpp"
#include "sonocal/solvers/normal_equations.hpp"

namespace sonocal {

// So many correspondences of one kind as structure of arrays; the last of a kind are filled up with rows that
// any transform satisfies.
struct UnitBlock {
  static constexpr int kUnits = 32;
  static constexpr int kFields = 7;  // point, normal, offset
  const double* data;                // of each row, of each field: kUnits numbers
  int rows;
  double per_point;  // 1 / number of points
  int slot, units;   // the first one's place, and how many there are
};

// Coordinates are of order one: centre and size of the sources, and of the targets the point nearest to all
// planes and their root mean square distance from it.
class UnitRows {
 public:
  using Column = Eigen::Array<double, Eigen::Dynamic, 1>;

  explicit UnitRows(const Correspondences& all);

  // A correspondence's place here; the places between kinds are of none.
  int slots() const { return static_cast<int>(unit_.size()); }
  int units() const { return units_; }
  int unit(int slot) const { return unit_[slot]; }  // its number in the table; -1 where there is none
  const std::vector<UnitKind>& kinds() const { return kinds_; }
  const UnitKind& kind(int slot) const { return kinds_[kind_[slot]]; }
  PointOnPlane row(int slot, int row) const;

  bool flat() const { return flat_; }    // all source points have the same third coordinate
  double size() const { return size_; }  // of the targets, in their unit
  double source_size() const { return source_size_; }
  Transform to_original(const Transform& a) const;

  // Of every place, mean squared distance of its points from their planes.
  void squares(const Transform& a, Column& out) const;
  // sum of min(that, limit), given up (returning at least `enough`) once it reaches `enough` or a random
  // part of it says that it would.
  double truncated_sum(const Transform& a, double limit, double enough) const;
  // The cost of those within the limit.
  NormalEquations cost(const Column& squares, double limit) const;
  int rows_within(const Column& squares, double limit) const;
  // Of each kind, the share within the limit.
  std::vector<double> shares_within(const Column& squares, double limit) const;

 private:
  void normalise(const Correspondences& all);
  void lay_out(const Correspondences& all);
  double* add_block(const Correspondences& all, int of_kind, int begin, double* to);

  std::vector<UnitKind> kinds_;
  int units_;
  Vector3d source_centre_ = Vector3d::Zero(), centre_ = Vector3d::Zero();
  double source_size_ = 1, size_ = 1;
  bool flat_ = true;
  std::vector<int> unit_, kind_;  // of each place
  std::vector<double> data_;
  std::vector<UnitBlock> blocks_;  // kind by kind
  std::vector<UnitBlock> scored_;  // the same, kinds in turn
};

}  // namespace sonocal
