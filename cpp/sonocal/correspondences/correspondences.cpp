#include "sonocal/correspondences/correspondences.hpp"

#include <algorithm>
#include <numeric>

#include "sonocal/linalg/small.hpp"
#include "sonocal/solvers/gauss_newton.hpp"

namespace sonocal {
namespace {

constexpr int kMostUnits = 7;  // a correspondence is one row at least
constexpr int kCandidateSteps = 6, kLocalRounds = 6, kLocalSteps = 2, kFinalRounds = 20, kFinalSteps = 30;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Information this small beside the largest, in coordinates of order one, leaves a motion free.
constexpr double kFree = 1e-12;
constexpr double kAtRest = 1e-9;
// Planes of a sample that pass a point so closely, beside all correspondences', meet.
constexpr double kMeeting = 1e-6;

// Whether the rows hold all seven motions about `a`; of a known scale, the other six.
bool determined(const std::vector<PointOnPlane>& rows, const Transform& a, bool scale_known) {
  Vector3d centre = Vector3d::Zero();
  for (const auto& row : rows) centre += row.point / static_cast<double>(rows.size());
  double size = 0;
  for (const auto& row : rows) size = std::max(size, (row.point - centre).norm());
  Eigen::Matrix<double, 7, 7> information = Eigen::Matrix<double, 7, 7>::Zero();
  for (const auto& row : rows) {
    const Vector3d arm = a.rotation * (row.point - centre) / size;
    Eigen::Matrix<double, 7, 1> jacobian;
    jacobian << cross(arm, row.normal), row.normal, scale_known ? 0.0 : row.normal.dot(arm);
    information += jacobian * jacobian.transpose();
  }
  if (!information.allFinite()) return false;
  const SmallVector values = symmetric_eigenvalues(information);
  return values[scale_known ? 1 : 0] > kFree * values[6];
}

// Root mean square distance of the planes from the point nearest to all of them: nothing but this size tells
// a similarity from one that shrinks the source to that point.
double spread_of(const std::vector<PointOnPlane>& rows) {
  Matrix3d normals = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const auto& row : rows) {
    normals += row.normal * row.normal.transpose();
    right -= row.offset * row.normal;
  }
  const Vector3d nearest = least_squares(normals, right);
  double sum = 0;
  for (const auto& row : rows) sum += std::pow(row.normal.dot(nearest) + row.offset, 2);
  return std::sqrt(sum / static_cast<double>(rows.size()));
}

class Estimator {
 public:
  using Model = Transform;
  using Models = std::array<Transform, 8>;

  Estimator(const Correspondences& all, const CorrespondenceOptions& options)
      : all_(all), options_(options), limit_(options.threshold * options.threshold) {
    const int rows = all.first[all.count];
    rows_.resize(rows);
    for (int i = 0; i < rows; ++i) rows_[i] = read_row(all.points, all.planes, i);
    spread_ = spread_of(rows_);
    // A sample is of about as many correspondences as have seven rows.
    size_ = std::clamp(static_cast<int>(std::ceil(7.0 * all.count / std::max(rows, 1))), 1, kMostUnits);
  }

  int units() const { return all_.count; }
  int sample_size() const { return std::min(size_, units()); }
  bool enumerable() const { return false; }
  void draw(Random& random, Sample& sample) const {
    for (int drawn = 0; drawn < most_units();) {
      const int candidate = random.below(units());
      if (std::find(sample.begin(), sample.begin() + drawn, candidate) == sample.begin() + drawn)
        sample[drawn++] = candidate;
    }
  }

  // Planes on planes hold less than they have rows, and lines that meet do: where the sample's planes meet
  // in a point, or candidates leave a motion free, one more correspondence joins it.
  int solve(const Sample& sample, Random&, Models& out) const {
    std::vector<PointOnPlane> rows;
    for (int units = 1; units <= most_units(); ++units) {
      const PointOnPlane* first = &rows_[all_.first[sample[units - 1]]];
      rows.insert(rows.end(), first, first + size_of(sample[units - 1]));
      if (rows.size() < 7 || !(spread_of(rows) > kMeeting * spread_)) continue;
      int count = three_quadrics(in_turn(sample, units), out, NoRealRoot::kRealPart);
      count = refine_candidates(rows.data(), static_cast<int>(rows.size()), kCandidateSteps,
                                options_.fixed_scale, out.data(), count);
      const auto free = [&](const Transform& a) { return !determined(rows, a, options_.fixed_scale > 0); };
      count = static_cast<int>(std::remove_if(out.begin(), out.begin() + count, free) - out.begin());
      if (count > 0) return count;
    }
    return 0;
  }

  double score(const Transform& a, double enough) const {
    double sum = 0;
    for (int c = 0; c < all_.count && sum < enough; ++c) sum += std::min(square(a, c), limit_);
    return sum;
  }
  double inlier_share(const Transform& a) const {
    return static_cast<double>(agreeing(a).size()) / all_.count;
  }
  bool improve(Transform& a, double& score) const { return optimise(a, score, kLocalRounds, kLocalSteps); }

  // Refined on the correspondences that agree until it and they come to rest; true if they did.
  bool settle(Transform& a, double& score) const {
    optimise(a, score, kFinalRounds, kFinalSteps);
    const auto rows = rows_of(agreeing(a), true);
    const double before = squared_residuals(rows.data(), static_cast<int>(rows.size()), a);
    const double after =
        gauss_newton(rows.data(), static_cast<int>(rows.size()), kFinalSteps, options_.fixed_scale, a);
    return before - after <= kAtRest * before + 1e-24;
  }

  std::vector<int> agreeing(const Transform& a) const {
    std::vector<int> out;
    for (int c = 0; c < all_.count; ++c)
      if (square(a, c) <= limit_) out.push_back(c);
    return out;
  }
  // Mean squared distance of the correspondence's points.
  double square(const Transform& a, int c) const {
    const int begin = all_.first[c], end = all_.first[c + 1];
    int points = 0;
    for (int i = begin; i < end; ++i) points += i == begin || rows_[i].point != rows_[i - 1].point;
    return squared_residuals(&rows_[begin], end - begin, a) / points;
  }

 private:
  int most_units() const { return std::min(kMostUnits, units()); }
  int size_of(int c) const { return all_.first[c + 1] - all_.first[c]; }

  // Seven rows, one of each correspondence in turn.
  std::array<PointOnPlane, 7> in_turn(const Sample& sample, int units) const {
    std::array<PointOnPlane, 7> out;
    int taken = 0;
    for (int round = 0; taken < 7; ++round)
      for (int u = 0; u < units && taken < 7; ++u)
        if (round < size_of(sample[u])) out[taken++] = rows_[all_.first[sample[u]] + round];
    return out;
  }

  std::vector<PointOnPlane> rows_of(const std::vector<int>& chosen, bool weighted = false) const {
    std::vector<PointOnPlane> out;
    for (const int c : chosen)
      for (int i = all_.first[c]; i < all_.first[c + 1]; ++i) {
        const double weight = weighted && options_.weights ? options_.weights[c] : 1.0;
        out.push_back({rows_[i].point, weight * rows_[i].normal, weight * rows_[i].offset});
      }
    return out;
  }

  bool optimise(Transform& a, double& score, int rounds, int steps) const {
    bool improved = false;
    for (int round = 0; round < rounds; ++round) {
      Transform next = a;
      const auto rows = rows_of(agreeing(a));
      if (rows.size() < 7) break;
      gauss_newton(rows.data(), static_cast<int>(rows.size()), steps, options_.fixed_scale, next);
      const double next_score = this->score(next, kInfinity);
      if (!(next_score < score)) break;
      improved = true;
      const bool little = score - next_score <= kAtRest * score;
      a = next;
      score = next_score;
      if (little) break;
    }
    return improved;
  }

  const Correspondences& all_;
  const CorrespondenceOptions& options_;
  const double limit_;
  std::vector<PointOnPlane> rows_;
  double spread_ = 0;
  int size_;
};

}  // namespace

CorrespondenceEstimate estimate(const Correspondences& correspondences,
                                const CorrespondenceOptions& options) {
  Estimator estimator(correspondences, options);
  CorrespondenceEstimate result;
  auto best = find_consensus(estimator, options.consensus);
  result.samples = best.samples;
  result.found = std::isfinite(best.score);
  if (!result.found) return result;
  if (options.refine) result.converged = estimator.settle(best.model, best.score);
  result.transform = best.model;
  result.inliers = static_cast<int>(estimator.agreeing(best.model).size());
  for (int c = 0; c < correspondences.count; ++c) result.squares.push_back(estimator.square(best.model, c));
  return result;
}

}  // namespace sonocal
