#include "sonocal/correspondences/label_shift.hpp"

#include <cmath>

#include "sonocal/correspondences/label_fit.hpp"
#include "sonocal/linalg/ldlt.hpp"

namespace sonocal {
namespace {

constexpr int kShiftRounds = 4;

Vector3d across_wire(const LabelScene& scene, const Transform& a, int frame, const DotOnWire& pair) {
  const Vector2d& x = scene.dot(pair.dot);
  const Vector3d direction = scene.direction(frame, pair.wire);
  const Vector3d from = a.apply({x.x(), x.y(), 0}) - scene.foot(frame, pair.wire);
  return from - from.dot(direction) * direction;
}

// Ridge least squares; pairs that are far off, as wrong ones are, weigh less.
Vector3d shared_shift(const LabelScene& scene, const Transform& a, int frame,
                      const std::vector<DotOnWire>& pairs, double reach, const FrameErrors& errors) {
  using Matrix3 = Ldlt<3>::Matrix;
  Matrix3 information = Matrix3::Identity() * (errors.dot * errors.dot / (errors.shift * errors.shift));
  Vector3d pull = Vector3d::Zero();
  for (const DotOnWire& pair : pairs) {
    const Vector3d direction = scene.direction(frame, pair.wire);
    const double weight = 1 / (1 + pair.square / (reach * reach));
    information += weight * (Matrix3::Identity() - direction * direction.transpose());
    pull -= weight * across_wire(scene, a, frame, pair);
  }
  return Ldlt<3>(information).solve(pull);
}

}  // namespace

ShiftedFrame shift_frame(const LabelScene& scene, const Transform& a, int frame, double reach,
                         const FrameErrors& errors) {
  const double within = errors.dot * std::sqrt(2 * kMostCost), all = scene.dots(frame) * kMostCost;
  ShiftedFrame best, next;
  best.cost = all;
  pairs_within(scene, a, frame, reach, next.pairs);
  for (int round = 0; round < kShiftRounds && !next.pairs.empty(); ++round) {
    next.shift = shared_shift(scene, a, frame, next.pairs, within, errors);
    Transform shifted = a;
    shifted.translation += next.shift;
    next.pairs.clear();
    pairs_within(scene, shifted, frame, within, next.pairs);
    next.cost = all + next.shift.squaredNorm() / (2 * errors.shift * errors.shift);
    for (const DotOnWire& pair : next.pairs)
      next.cost += pair.square / (2 * errors.dot * errors.dot) - kMostCost;
    if (next.cost < best.cost) best = next;
  }
  return best;
}

}  // namespace sonocal
