#include "sonocal/consensus.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "sonocal/random.hpp"
#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/two_lines.hpp"

namespace sonocal {
namespace {

using Column = PointLines::Column;

// Candidates of one minimal sample.
using Candidates = std::array<Transform, 4>;

// A sampler proposes minimal samples; the loop below knows nothing of points or lines.
//   units():        what is sampled
//   sample_size():  how many units make a sample
//   solve(units, random, candidates): the sample's solutions

class FourRows {
 public:
  explicit FourRows(const PointLines& rows) : rows_(rows) {}
  int units() const { return rows_.size(); }
  int sample_size() const { return 4; }
  bool enumerable() const { return true; }

  int solve(const std::array<int, 4>& units, Random&, Candidates& out) const {
    std::array<PointOnLine, 4> problem;
    for (int i = 0; i < 4; ++i) {
      const int row = units[i];
      problem[i] = {rows_.point(row).head<2>(), rows_.line_point(row), rows_.direction(row)};
    }
    return four_points(problem, out, NoRealRoot::kRealPart);
  }

 private:
  const PointLines& rows_;
};

class TwoSightings {
 public:
  TwoSightings(const PointLines& rows, const std::vector<int>& sightings) : rows_(rows) {
    std::vector<std::vector<int>> groups(
        sightings.empty() ? 0 : 1 + *std::max_element(sightings.begin(), sightings.end()));
    for (int row = 0; row < rows.size(); ++row) groups[sightings[row]].push_back(row);
    for (auto& group : groups) {
      if (group.size() < 2) continue;
      pairs_only_ = pairs_only_ && group.size() == 2;
      members_.push_back(std::move(group));
    }
  }
  int units() const { return static_cast<int>(members_.size()); }
  int sample_size() const { return 2; }
  // With more than two points on a line the choice of the two is part of the sample.
  bool enumerable() const { return pairs_only_; }

  int solve(const std::array<int, 4>& units, Random& random, Candidates& out) const {
    std::array<Line, 2> image, needles;
    for (int i = 0; i < 2; ++i) {
      const auto& members = members_[units[i]];
      int a = 0, b = 1;
      if (members.size() > 2) {
        a = random.below(static_cast<int>(members.size()));
        b = random.below(static_cast<int>(members.size()) - 1);
        b += b >= a;
      }
      const Vector3d first = rows_.point(members[a]), second = rows_.point(members[b]);
      image[i] = {first, (second - first).normalized()};
      needles[i] = {rows_.line_point(members[a]), rows_.direction(members[a])};
    }
    std::array<Transform, 2> both;
    const int count = two_lines(image, needles, both);
    std::copy_n(both.begin(), count, out.begin());
    return count;
  }

 private:
  const PointLines& rows_;
  std::vector<std::vector<int>> members_;
  bool pairs_only_ = true;
};

double combinations(int n, int k) {
  double count = 1;
  for (int i = 0; i < k; ++i) count *= static_cast<double>(n - i) / (i + 1);
  return std::round(count);
}

// The next combination in lexicographic order; false after the last.
bool next_combination(std::array<int, 4>& units, int size, int n) {
  for (int i = size - 1; i >= 0; --i) {
    if (units[i] < n - size + i) {
      ++units[i];
      for (int j = i + 1; j < size; ++j) units[j] = units[j - 1] + 1;
      return true;
    }
  }
  return false;
}

void draw_distinct(std::array<int, 4>& units, int size, int n, Random& random) {
  for (int i = 0; i < size; ++i) {
    int candidate;
    do candidate = random.below(n);
    while (std::find(units.begin(), units.begin() + i, candidate) != units.begin() + i);
    units[i] = candidate;
  }
}

struct Best {
  Transform transform;
  double score = std::numeric_limits<double>::infinity();
  int count = 0;
};

constexpr int kLocalRounds = 4;
constexpr int kLocalIterations = 3;
constexpr int kFinalRounds = 20;
constexpr int kFinalIterations = 60;
// Fewer samples than this prove nothing, whatever the share of inliers seems to be.
constexpr int kFewestSamples = 20;

// Brings a normalised answer, and `squares` with it, to original coordinates.
void report(const PointLines& rows, const Transform& normalised, const NormalEquations& equations,
            Model model, Estimate& result) {
  const Normalisation& normalisation = rows.normalisation();
  result.transform = normalisation.to_original(normalised);
  result.squares *= normalisation.size * normalisation.size;
  result.inliers = equations.rows();
  Tangent unused;
  equations.linearise(normalised, model, result.information, unused);
  result.found = true;
}

class Loop {
 public:
  Loop(const PointLines& rows, const Options& options)
      : rows_(rows),
        options_(options),
        limit_(std::pow(options.threshold_mm / rows.normalisation().size, 2)) {}

  template <class Sampler>
  Estimate run(const Sampler& sampler) {
    Estimate result;
    const int n = sampler.units(), size = sampler.sample_size();
    if (n < size) return result;
    const bool all = sampler.enumerable() && combinations(n, size) <= options_.exhaustive_samples;
    Random random(options_.seed);
    std::array<int, 4> units{0, 1, 2, 3};
    Candidates candidates;
    double needed = all ? combinations(n, size) : options_.max_samples;
    for (bool more = true; more && result.samples < needed; ++result.samples) {
      if (!all) draw_distinct(units, size, n, random);
      const int count = sampler.solve(units, random, candidates);
      bool improved = false;
      for (int i = 0; i < count; ++i) improved |= consider(candidates[i]);
      if (all)
        more = next_combination(units, size, n);
      else if (improved)
        needed = samples_needed(size);
    }
    finish(result);
    return result;
  }

 private:
  bool consider(const Transform& candidate) {
    const double score = rows_.truncated_sum(candidate, limit_, best_.score);
    if (!(score < best_.score)) return false;
    best_.transform = candidate;
    best_.score = score;
    optimise(kLocalRounds, kLocalIterations);
    return true;
  }

  // Refines on the rows that agree, again and again, while the score falls; true if it settled.
  bool optimise(int rounds, int iterations) {
    bool converged = false;
    for (int round = 0; round < rounds; ++round) {
      const Refinement refined = refit(limit_, iterations);
      const double score = score_of(refined.transform);
      converged = refined.converged;
      const bool better = score < best_.score;
      if (score <= best_.score) best_ = {refined.transform, score, best_.count};
      if (!better) break;
    }
    rows_.squared_distances(best_.transform, squares_);
    best_.count = static_cast<int>((squares_ <= limit_).count());
    return converged;
  }

  // Two fits that differ by a row near the threshold are both stable. Refitting from the rows within half
  // and twice the threshold finds the better one, whatever the samples happened to be.
  void try_other_thresholds() {
    bool improved = true;
    for (int round = 0; improved && round < kLocalRounds; ++round) {
      improved = false;
      for (const double factor : {0.25, 4.0})
        improved |= consider(refit(factor * limit_, kLocalIterations).transform);
    }
  }

  Refinement refit(double limit, int iterations) {
    const NormalEquations equations = agreeing(limit);
    if (2 * equations.rows() <= parameter_count(options_.model)) return {best_.transform, 0, 0, false};
    return refine(equations, best_.transform, options_.model, iterations);
  }

  double score_of(const Transform& a) const {
    return rows_.truncated_sum(a, limit_, std::numeric_limits<double>::infinity());
  }

  NormalEquations agreeing(double limit) {
    rows_.squared_distances(best_.transform, squares_);
    NormalEquations equations(rows_.dimension());
    equations.add_inliers(rows_, squares_, limit);
    return equations;
  }

  // Samples after which one without outliers has been drawn, to the confidence asked for.
  double samples_needed(int sample_size) const {
    const double clean = std::pow(static_cast<double>(best_.count) / rows_.size(), sample_size);
    if (!(clean > 0)) return options_.max_samples;
    const double needed = clean < 1 ? std::log1p(-options_.confidence) / std::log1p(-clean) : 0;
    return std::clamp(needed, static_cast<double>(std::min(kFewestSamples, options_.max_samples)),
                      static_cast<double>(options_.max_samples));
  }

  void finish(Estimate& result) {
    result.best_count = best_.count;
    if (!std::isfinite(best_.score)) return;
    try_other_thresholds();
    result.converged = optimise(kFinalRounds, kFinalIterations);
    const NormalEquations equations = agreeing(limit_);
    result.squares = squares_;
    result.best_count = equations.rows();
    report(rows_, best_.transform, equations, options_.model, result);
  }

  const PointLines& rows_;
  const Options& options_;
  const double limit_;
  Best best_;
  Column squares_;
};

}  // namespace

Estimate refine_chosen(const PointLines& rows, const bool* chosen, const Transform& start, Model model,
                       int max_iterations) {
  const Normalisation& normalisation = rows.normalisation();
  Column selector(rows.size());
  for (int i = 0; i < rows.size(); ++i) selector[i] = chosen[i] ? 0.0 : 1.0;
  NormalEquations equations(rows.dimension());
  equations.add_inliers(rows, selector, 0.5);
  const Refinement refined = refine(equations, normalisation.to_normalised(start), model, max_iterations);
  Estimate result;
  rows.squared_distances(refined.transform, result.squares);
  report(rows, refined.transform, equations, model, result);
  result.converged = refined.converged;
  return result;
}

Estimate estimate(const PointLines& rows, const std::vector<int>& sightings, const Options& options) {
  Loop loop(rows, options);
  return rows.dimension() == 2 ? loop.run(FourRows(rows)) : loop.run(TwoSightings(rows, sightings));
}

}  // namespace sonocal
