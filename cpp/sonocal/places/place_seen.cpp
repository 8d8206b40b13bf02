#include "sonocal/places/place_seen.hpp"

#include <algorithm>
#include <limits>

#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

constexpr int kSamples = 200;

double scored(const std::vector<Vector3d>& seen, const Place& place, double limit) {
  double sum = 0;
  for (const Vector3d& y : seen) sum += std::min(place.square(y), limit);
  return sum;
}

// Least squares of those within the limit.
Place settled(const std::vector<Vector3d>& seen, const Place& place, double limit) {
  Vector3d middle = Vector3d::Zero();
  int count = 0;
  for (const Vector3d& y : seen)
    if (place.square(y) < limit) {
      middle += y;
      ++count;
    }
  if (count < place.spans) return place;
  middle /= count;
  Matrix3d spread = Matrix3d::Zero();
  for (const Vector3d& y : seen)
    if (place.square(y) < limit) spread += (y - middle) * (y - middle).transpose();
  const SymmetricEigen eigen = symmetric_eigen(spread);
  Place out = place_along(place.spans, Vector3d(eigen.vectors.col(place.spans == 3 ? 0 : 2)));
  out.base = middle;
  return out;
}

}  // namespace

Place place_seen(const std::vector<Vector3d>& seen, int spans, double limit, Random& random) {
  const int count = static_cast<int>(seen.size());
  Place best = place_along(spans, Vector3d::UnitZ());
  if (count) best.base = seen[0];
  if (count < spans) return best;
  double least = std::numeric_limits<double>::infinity();
  for (int sample = 0; sample < kSamples; ++sample) {
    double spanning[9];
    for (int k = 0; k < spans; ++k) Eigen::Map<Vector3d>(spanning + 3 * k) = seen[random.below(count)];
    const Place place = place_through(spans, spanning);
    if (!place.axes.allFinite() || !(place.axes.colwise().norm().minCoeff() > 0.5)) continue;
    const double score = scored(seen, place, limit);
    if (score < least) {
      least = score;
      best = place;
    }
  }
  const Place better = settled(seen, best, limit);
  return scored(seen, better, limit) < least ? better : best;
}

}  // namespace sonocal
