#include "sonocal/places/search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/linalg/sort_by.hpp"
#include "sonocal/places/descend.hpp"
#include "sonocal/places/relaxed.hpp"
#include "sonocal/robust/random.hpp"

namespace sonocal {
namespace {

constexpr int kDirections = 150;
// Directions of a sample that are gone on with; of the only one there is, more.
constexpr int kTried[4] = {0, 1, 2, 4};
constexpr int kTriedOfOne = 60;
constexpr int kTurns = 24;
constexpr double kApart = 0.9;  // cosine of directions that are two minima, not one
constexpr int kKept = 12;
constexpr int kFewestPlaceSamples = 24;

class Search {
 public:
  Search(const PosedRows& rows, int scales, const PlaceSearch& options)
      : rows_(rows),
        unknowns_(rows, scales, false),
        options_(options),
        limit_(std::pow(options.threshold_mm / rows.normalisation().size, 2)),
        random_(options.seed) {
    for (int i = 0; i < rows.size(); ++i) all_.push_back(i);
    for (const Vector3d& direction : half_sphere(spans() == 1 ? 1 : kDirections))
      along_.push_back(place_along(spans(), direction));
    for (int i = 0; i < rows.size(); ++i) outermost(i);
  }

  std::vector<PlaceCandidate> run(int* samples) {
    const int size = std::min(sample_size(), rows_.size());
    double needed = options_.most_samples;
    int drawn = 0;
    while (drawn < needed) {
      allow_interrupt();
      ++drawn;
      sample_ = all_;
      for (int k = 0; k < size; ++k) std::swap(sample_[k], sample_[k + random_.below(rows_.size() - k)]);
      sample_.resize(size);
      try_sample();
      if (size == rows_.size()) break;
      needed = std::min<double>(options_.most_samples, needed_for(size));
    }
    if (samples) *samples = drawn;
    return std::move(kept_);
  }

 private:
  int spans() const { return rows_.target(0).prior.spans; }
  // Equations of a row, numbers that the relaxed system asks for, and a spare frame that tells directions
  // apart.
  int sample_size() const {
    const int normals = 4 - spans(), asked = 3 * rows_.dimension() + 3 + normals + (spans() > 1 ? 2 : 0);
    return (asked + normals - 1) / normals + (spans() == 3 ? 2 : 0);
  }

  // The image's extreme rows, which answers are told apart by.
  void outermost(int i) {
    for (int axis = 0; axis < 3; ++axis)
      for (int end = 0; end < 2; ++end) {
        int& best = extreme_[2 * axis + end];
        const double sign = end ? 1 : -1;
        if (best < 0 || sign * rows_.row(i).x[axis] > sign * rows_.row(best).x[axis]) best = i;
      }
  }

  void try_sample() {
    RelaxedSystem system(rows_, sample_.data(), static_cast<int>(sample_.size()));
    std::vector<std::pair<double, int>> costs;
    for (int d = 0; d < static_cast<int>(along_.size()); ++d) {
      double cost;
      if (system.cost(along_[d], &cost)) costs.emplace_back(cost, d);
    }
    std::sort(costs.begin(), costs.end());
    const bool only = sample_.size() == all_.size();
    const std::size_t most = only ? kTriedOfOne : kTried[spans()];
    std::vector<int> tried;
    for (const auto& [cost, d] : costs) {
      const int axis = spans() == 2 ? 2 : 0;
      const Vector3d direction = along_[d].axes.col(axis);
      if (std::any_of(tried.begin(), tried.end(), [&](int other) {
            return !only && std::abs(along_[other].axes.col(axis).dot(direction)) > kApart;
          }))
        continue;
      const auto relaxed = system.solve(along_[d]);
      if (!relaxed) continue;
      refine(relaxed->answer);
      // A point has one direction to try: turns of the image are as good.
      for (int turn = 0; only && spans() == 1 && turn < kTurns; ++turn) refine(turned(relaxed->answer));
      tried.push_back(d);
      if (tried.size() == most) break;
    }
  }

  PlacesAnswer turned(PlacesAnswer at) {
    Vector3d by;
    for (int axis = 0; axis < 3; ++axis) by[axis] = (random_.below(2001) - 1000) * 1e-3 * M_PI;
    at.a.rotation = rotation_by(by) * at.a.rotation;
    return at;
  }

  void refine(PlacesAnswer at) {
    based(at);
    Descent how;
    how.iterations = sample_.size() == all_.size() ? 40 : 12;
    how.tolerance = sample_.size() == all_.size() ? 1e-6 : 1e-3;
    descend(rows_, sample_.data(), static_cast<int>(sample_.size()), unknowns_, how, at);
    double score = scored(at);
    if (!(score < 0.9 * limit_ * rows_.size())) return;
    if (kept_.empty() || score < 2 * kept_.front().score || kept_.size() < kKept) {
      how.scale = std::sqrt(limit_);
      how.iterations = 6;
      descend(rows_, all_.data(), rows_.size(), unknowns_, how, at);
      score = scored(at);
    }
    keep({at, score});
  }

  void based(PlacesAnswer& at) const {
    Vector3d middle = Vector3d::Zero();
    for (int i : sample_) middle += rows_.seen(at.a, 0, i) / static_cast<double>(sample_.size());
    at.places[0] = based_near(at.places[0], middle);
  }

  double scored(const PlacesAnswer& at) const {
    double sum = 0;
    for (int i : all_) sum += std::min(rows_.square(at, i), limit_);
    return sum;
  }

  bool same(const PlacesAnswer& a, const PlacesAnswer& b) const {
    for (int i : extreme_)
      if ((a.a.apply(rows_.row(i).x) - b.a.apply(rows_.row(i).x)).squaredNorm() > limit_) return false;
    return true;
  }

  void keep(const PlaceCandidate& candidate) {
    for (PlaceCandidate& other : kept_)
      if (same(other.answer, candidate.answer)) {
        if (candidate.score < other.score) other = candidate;
        order();
        return;
      }
    kept_.push_back(candidate);
    order();
    if (kept_.size() > kKept) kept_.pop_back();
  }
  void order() {
    sort_by(kept_, [](const auto& one) { return one.score; });
  }

  double needed_for(int size) const {
    if (kept_.empty()) return options_.most_samples;
    int inliers = 0;
    for (int i : all_) inliers += rows_.square(kept_.front().answer, i) < limit_;
    double clean = 1;
    for (int k = 0; k < size; ++k) clean *= std::max(inliers - k, 0) / static_cast<double>(rows_.size() - k);
    if (clean >= 1) return kFewestPlaceSamples;
    // Of clean samples not every one is well placed.
    return std::max<double>(kFewestPlaceSamples, 3 * std::log(1 - options_.confidence) / std::log1p(-clean));
  }

  const PosedRows& rows_;
  const Unknowns unknowns_;
  const PlaceSearch& options_;
  const double limit_;
  Random random_;
  std::vector<int> all_, sample_;
  std::vector<Place> along_;
  int extreme_[6] = {-1, -1, -1, -1, -1, -1};
  std::vector<PlaceCandidate> kept_;
};

}  // namespace

std::vector<PlaceCandidate> search_place(const PosedRows& rows, int scales, const PlaceSearch& options,
                                         int* samples) {
  return Search(rows, scales, options).run(samples);
}

}  // namespace sonocal
