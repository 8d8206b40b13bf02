#include "sonocal/solvers/gauss_newton.hpp"

#include <algorithm>
#include <array>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/product.hpp"

namespace sonocal {
namespace {

using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

constexpr double kRounding = 1e-13;

// The tangent turns and grows the image about its centre, which `centre` is carried to.
struct Linearised {
  Matrix7d matrix = Matrix7d::Zero();
  Vector7d right = Vector7d::Zero();
};

Linearised linearise(const PointOnPlane* rows, int count, const Vector3d& image_centre, double unit,
                     const Transform& a) {
  Linearised out;
  const Vector3d centre = a.apply(image_centre);
  for (int i = 0; i < count; ++i) {
    const Vector3d arm = a.scales[0] * (a.rotation * (rows[i].point - image_centre));
    const Vector3d& n = rows[i].normal;
    Vector7d row;
    row << cross(arm, n) * unit, n, n.dot(arm) * unit;
    const double residual = n.dot(arm + centre) + rows[i].offset;
    out.matrix.noalias() += row * row.transpose();
    out.right.noalias() -= row * residual;
  }
  return out;
}

Transform retract(const Transform& a, const Vector7d& step, double unit, const Vector3d& image_centre) {
  Transform out = a;
  const Vector3d turn = step.head<3>() * unit;
  out.rotation = product(rotation_by(turn), a.rotation);
  out.scales *= std::exp(step[6] * unit);
  out.translation = a.apply(image_centre) + step.segment<3>(3) - out.linear() * image_centre;
  return out;
}

}  // namespace

double squared_residuals(const PointOnPlane* rows, int count, const Transform& a) {
  double sum = 0;
  const Matrix3d s = a.linear();
  for (int i = 0; i < count; ++i) {
    const double r = rows[i].normal.dot(s * rows[i].point + a.translation) + rows[i].offset;
    sum += r * r;
  }
  return sum;
}

double gauss_newton(const PointOnPlane* rows, int count, int steps, double fixed_scale, Transform& a) {
  Vector3d image_centre = Vector3d::Zero();
  for (int i = 0; i < count; ++i) image_centre += rows[i].point / count;
  double spread = 0;
  for (int i = 0; i < count; ++i) spread += (rows[i].point - image_centre).squaredNorm() / count;
  if (fixed_scale > 0) {
    const Vector3d centre = a.apply(image_centre);
    a.scales.setConstant(fixed_scale);
    a.translation = centre - a.linear() * image_centre;
  }
  double cost = squared_residuals(rows, count, a);
  double damping = 1e-12;
  for (int step = 0; step < steps; ++step) {
    // Nothing but rounding is left: a step would follow it.
    if (cost <= count * spread * std::pow(kRounding * a.scales[0], 2)) break;
    // Turns and growth in units that move a typical point by one.
    const double unit = 1.0 / (a.scales[0] * std::sqrt(spread));
    const Linearised equations = linearise(rows, count, image_centre, unit, a);
    bool better = false;
    for (int trial = 0; trial < 4 && !better; ++trial) {
      Linearised damped = equations;
      damped.matrix.diagonal().array() += damping * equations.matrix.trace();
      if (fixed_scale > 0) {
        damped.matrix.row(6).setZero();
        damped.matrix.col(6).setZero();
        damped.matrix(6, 6) = 1;
        damped.right[6] = 0;
      }
      const Transform next = retract(a, Ldlt<7>(damped.matrix).solve(damped.right), unit, image_centre);
      const double next_cost = squared_residuals(rows, count, next);
      better = next_cost < cost;
      if (better) {
        a = next;
        cost = next_cost;
        damping = std::max(1e-12, damping * 1e-2);
      } else {
        damping = std::max(1e-3, damping * 10);
      }
    }
    if (!better) break;
  }
  a.rotation = orthonormal(a.rotation);
  return cost;
}

int refine_candidates(const PointOnPlane* rows, int count, int steps, double fixed_scale,
                      Transform* candidates, int candidate_count) {
  std::array<Transform, 16> refined;
  std::array<std::pair<double, int>, 16> order;
  int kept = 0;
  for (int i = 0; i < candidate_count; ++i) {
    Transform& a = candidates[i];
    const double cost = gauss_newton(rows, count, steps, fixed_scale, a);
    if (!std::isfinite(cost) || !std::isfinite(a.translation.sum()) || !(a.scales[0] > 0)) continue;
    const auto same = [&](const auto& other) {
      return (other.rotation - a.rotation).squaredNorm() < 1e-14 &&
             std::fabs(other.scales[0] - a.scales[0]) < 1e-7 * a.scales[0];
    };
    if (std::any_of(refined.begin(), refined.begin() + kept, same)) continue;
    order[kept] = {cost, kept};
    refined[kept++] = a;
  }
  std::sort(order.begin(), order.begin() + kept);
  for (int i = 0; i < kept; ++i) candidates[i] = refined[order[i].second];
  return kept;
}

}  // namespace sonocal
