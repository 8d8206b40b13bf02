// Minimal samples of a table of sightings.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "sonocal/estimate/point_lines.hpp"
#include "sonocal/estimate/sightings.hpp"
#include "sonocal/robust/consensus.hpp"
#include "sonocal/solvers/batch.hpp"

namespace sonocal {

using Candidates = std::array<Transform, 8>;

// What rows have in common: the image they are in and the needle or wire they are of; null: nothing known.
struct Labels {
  const std::int32_t* frame = nullptr;
  const std::int32_t* target = nullptr;
};

// Four rows of a 2D probe, or three where the scale is known.
class ImageRows {
 public:
  // A scale > 0 is known, of the rows' coordinates.
  ImageRows(const PointLines& rows, Labels labels, double scale);
  int units() const { return rows_.size(); }
  int sample_size() const { return scale_ > 0 ? 3 : 4; }
  bool enumerable() const { return true; }
  // Rows of one frame are nearly the same information, and so are rows of one wire: a sample takes
  // different ones where there are enough.
  void draw(Random& random, Sample& sample);
  int solve(const Sample& sample, Random&, Candidates& out);

 private:
  // Samples are drawn and solved several at a time, side by side in vectors, and handed out one by one.
  static constexpr int kAhead = 8;
  bool repeats(const Sample& sample, int drawn, int candidate) const;
  void draw_one(Random& random, Sample& sample) const;
  void solve_samples(const Sample* samples, int count, BatchOut out) const;
  void solve_fours(const Sample* samples, int count, BatchOut out) const;
  void solve_threes(const Sample* samples, int count, BatchOut out) const;
  int most() const { return scale_ > 0 ? 8 : 4; }

  const PointLines& rows_;
  Labels labels_;
  double scale_;
  std::array<Sample, kAhead> samples_;
  std::array<double, kAhead * 8 * 16> matrices_;
  std::array<std::int64_t, kAhead> counts_;
  int next_ = kAhead;
  bool drawn_ = false;
};

// Two sightings of a 3D probe, two points of each.
class TwoSightings {
 public:
  TwoSightings(const PointLines& rows, const Sightings& sightings);
  int units() const { return static_cast<int>(lines_.size()); }
  int sample_size() const { return 2; }
  // With more than two points on a line the choice of the two is part of the sample.
  bool enumerable() const { return pairs_only_; }
  void draw(Random& random, Sample& sample) const;
  int solve(const Sample& sample, Random& random, Candidates& out) const;
  Vector3d centre(const Sample& sample) const;

 private:
  const PointLines& rows_;
  const Sightings& sightings_;
  std::vector<int> lines_;  // sightings of two points or more
  bool pairs_only_ = true;
};

// The samples of another sampler, whose answers are given a known scale: grown about the sample's centre,
// which stays where it is. Two lines determine their scale, and refinement on the rows that agree mends what
// a wrong one has done to the rotation.
template <class Sampler>
class AtScale {
 public:
  AtScale(Sampler sampler, double scale) : sampler_(std::move(sampler)), scale_(scale) {}
  int units() const { return sampler_.units(); }
  int sample_size() const { return sampler_.sample_size(); }
  bool enumerable() const { return sampler_.enumerable(); }
  void draw(Random& random, Sample& sample) { sampler_.draw(random, sample); }
  int solve(const Sample& sample, Random& random, Candidates& out) {
    const int count = sampler_.solve(sample, random, out);
    const Vector3d centre = sampler_.centre(sample);
    for (int i = 0; i < count; ++i) {
      const Vector3d mapped = out[i].apply(centre);
      out[i].scales.setConstant(scale_);
      out[i].translation += mapped - out[i].apply(centre);
    }
    return count;
  }

 private:
  Sampler sampler_;
  double scale_;
};

}  // namespace sonocal
