// Minimal samples of correspondences of several kinds, and the similarities that solve them.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "sonocal/correspondences/unit_rows.hpp"
#include "sonocal/robust/consensus.hpp"

namespace sonocal {

// A sample is of as many correspondences as hold seven motions, or six where the scale is known. Half of the
// samples are of the kind that holds most alone, where there are enough of it: the fewer correspondences in a
// sample, the more samples are without outliers. Where weights differ, the first samples are of the best, and
// ever more join them (Chum and Matas 2005).
//
// Samples are drawn and solved several at a time, side by side in vectors, and handed out one by one.
class MixedSamples {
 public:
  static constexpr int kMostUnits = 7;  // a correspondence is one row at least
  using Models = std::array<Transform, 8>;

  // `weights`: of each correspondence; null: all alike. A scale > 0 is known.
  MixedSamples(const UnitRows& rows, const double* weights, double scale);

  void draw(Random& random);
  // Of the sample drawn last: of as many of its rows as are needed, or of its two lines.
  int solve(Models& out) const;
  // Whether they have the scale that is known: two lines have one of their own.
  bool at_scale() const { return scale_ > 0 && drawn_[next_].by != By::kLines; }
  // All its rows.
  const std::vector<PointOnPlane>& rows();
  // Whether they hold all motions about a solution.
  bool determine(const Transform& a);
  // Share of samples without outliers that determine a similarity, where these shares of each kind are sound.
  double clean_share(const std::vector<double>& sound) const;

 private:
  static constexpr int kAhead = 16;
  enum class By { kLines, kPoints, kRows };  // two lines on lines, three points on points: closed forms
  struct Drawn {
    std::array<int, kMostUnits> slot;
    int size = 0;
    By by = By::kRows;
    int place = 0;  // among the samples of its solver
  };

  int most_units() const;
  int pool(int size) const;
  // Two points hold five of the six motions that a known scale leaves: their distance is known.
  int held(const UnitKind& kind) const { return kind.held() - (kind.point && scale_ > 0); }
  void draw_one(Random& random, Drawn& out);
  void draw_ahead(Random& random);
  By solver_of(const Drawn& drawn) const;
  void solve_ahead();
  void put_lines(const Drawn& drawn, double* image, double* needles) const;
  void put_points(const Drawn& drawn, double* points, double* places) const;
  void put_rows(const Drawn& drawn, double* points, double* planes) const;
  bool by_conics() const { return flat_ && scale_ == 0; }
  int determined_ahead() const;
  void look(Random& random);
  void read_rows(const Drawn& drawn, std::vector<PointOnPlane>& out) const;
  bool determine(const std::vector<PointOnPlane>& rows, const Transform& a) const;
  int solutions(const Drawn& drawn, Models& out) const;
  double clean_share(const std::vector<double>& sound, int only) const;

  const UnitRows& rows_;
  const double scale_;
  const int motions_;  // that a sample holds
  const bool flat_;    // all points in one plane w = k
  const int strongest_kind_;
  bool ordered_ = false;
  std::vector<int> order_, strongest_;
  double spread_ = 0;
  int extra_ = 0;          // units beyond those that hold all motions, where these did not
  double determined_ = 1;  // share of the samples that do
  int samples_ = 0;
  std::array<Drawn, kAhead> drawn_;
  int next_ = kAhead;
  std::array<double, kAhead * 8 * 16> matrices_;
  std::array<double, kAhead * 2 * 16> line_matrices_;
  std::array<double, kAhead * 16> point_matrices_;
  std::array<std::int64_t, kAhead> counts_, line_counts_, point_counts_;
  std::vector<PointOnPlane> sample_rows_;
  int sample_rows_of_ = -1;
};

}  // namespace sonocal
