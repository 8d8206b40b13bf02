#include "sonocal/solvers/four_points.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "sonocal/solvers/polynomial.hpp"

namespace sonocal {
namespace {

// A 3-vector that is affine in the two unknowns: constant + alpha * a + mu * m.
struct Affine3 {
  Vector3d constant, a, m;

  Affine3 combine(double weight, const Affine3& other, double other_weight) const {
    return {weight * constant + other_weight * other.constant, weight * a + other_weight * other.a,
            weight * m + other_weight * other.m};
  }
  Affine3 minus(const Affine3& other) const { return combine(1.0, other, -1.0); }
  Vector3d at(double alpha, double mu) const { return constant + alpha * a + mu * m; }
};

// mm mu^2 + am alpha mu + m mu + aa alpha^2 + a alpha + one
struct Conic {
  double mm, am, m, aa, a, one;

  double at(double alpha, double mu) const {
    return mu * (mm * mu + am * alpha + m) + alpha * (aa * alpha + a) + one;
  }
  double by_alpha(double alpha, double mu) const { return am * mu + 2.0 * aa * alpha + a; }
  double by_mu(double alpha, double mu) const { return 2.0 * mm * mu + am * alpha + m; }
};

Conic dot(const Affine3& x, const Affine3& y) {
  return {x.m.dot(y.m),
          x.a.dot(y.m) + x.m.dot(y.a),
          x.constant.dot(y.m) + x.m.dot(y.constant),
          x.a.dot(y.a),
          x.constant.dot(y.a) + x.a.dot(y.constant),
          x.constant.dot(y.constant)};
}

Conic operator-(const Conic& x, const Conic& y) {
  return {x.mm - y.mm, x.am - y.am, x.m - y.m, x.aa - y.aa, x.a - y.a, x.one - y.one};
}

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

// A number that is affine in the two unknowns.
struct Affine1 {
  double constant, a, m;
};

Affine3 along(const Affine1& place, const Vector3d& direction) {
  return {place.constant * direction, place.a * direction, place.m * direction};
}

Vector3d widest_cross(const std::array<PointOnLine, 4>& problem) {
  Vector3d widest = Vector3d::Zero();
  for (int i = 0; i < 3; ++i)
    for (int j = i + 1; j < 4; ++j) {
      const Vector3d normal = problem[i].direction.cross(problem[j].direction);
      if (normal.squaredNorm() > widest.squaredNorm()) widest = normal;
    }
  return widest;
}

// Gauss-Jordan with full pivoting on the first five columns: three of them become unit vectors and are
// moved to the front, `order` says which. False where the rank is below three.
bool eliminate(Eigen::Matrix<double, 3, 6>& m, std::array<int, 5>& order) {
  const double largest = m.leftCols<5>().cwiseAbs().maxCoeff();
  for (int step = 0; step < 3; ++step) {
    int row = step, column = step;
    for (int c = step; c < 5; ++c)
      for (int r = step; r < 3; ++r)
        if (std::fabs(m(r, c)) > std::fabs(m(row, column))) {
          row = r;
          column = c;
        }
    if (!(std::fabs(m(row, column)) > 1e-13 * largest)) return false;
    m.row(step).swap(m.row(row));
    m.col(step).swap(m.col(column));
    std::swap(order[step], order[column]);
    m.row(step) /= m(step, step);
    for (int r = 0; r < 3; ++r)
      if (r != step) m.row(r) -= m(r, step) * m.row(step);
  }
  return true;
}

// Eliminates mu from two conics: mu = -constant(alpha) / slope(alpha), and the quartic in alpha.
struct Elimination {
  std::array<double, 3> constant;
  std::array<double, 2> slope;
  std::array<double, 5> quartic;

  double mu(double alpha) const {
    return -(constant[0] + alpha * (constant[1] + alpha * constant[2])) / (slope[0] + alpha * slope[1]);
  }
};

Elimination eliminate_mu(const Conic& f, const Conic& g) {
  Elimination e;
  e.slope = {f.mm * g.m - g.mm * f.m, f.mm * g.am - g.mm * f.am};
  e.constant = {f.mm * g.one - g.mm * f.one, f.mm * g.a - g.mm * f.a, f.mm * g.aa - g.mm * f.aa};
  // slope (f1 g0 - g1 f0) - constant^2, with f1, f0 the coefficients of mu and 1 in f.
  const std::array<double, 4> mixed{
      f.m * g.one - g.m * f.one, f.am * g.one + f.m * g.a - g.am * f.one - g.m * f.a,
      f.am * g.a + f.m * g.aa - g.am * f.a - g.m * f.aa, f.am * g.aa - g.am * f.aa};
  const auto& [c0, c1, c2] = e.constant;
  const auto& [s0, s1] = e.slope;
  e.quartic = {s0 * mixed[0] - c0 * c0, s0 * mixed[1] + s1 * mixed[0] - 2.0 * c0 * c1,
               s0 * mixed[2] + s1 * mixed[1] - 2.0 * c0 * c2 - c1 * c1,
               s0 * mixed[3] + s1 * mixed[2] - 2.0 * c1 * c2, s1 * mixed[3] - c2 * c2};
  return e;
}

void polish(const Conic& f, const Conic& g, double& alpha, double& mu) {
  for (int iteration = 0; iteration < 2; ++iteration) {
    const double fa = f.by_alpha(alpha, mu), fm = f.by_mu(alpha, mu);
    const double ga = g.by_alpha(alpha, mu), gm = g.by_mu(alpha, mu);
    const double f0 = f.at(alpha, mu), g0 = g.at(alpha, mu);
    const double inverse = 1.0 / (fa * gm - fm * ga);
    const double da = (f0 * gm - g0 * fm) * inverse, dm = (fa * g0 - ga * f0) * inverse;
    if (!std::isfinite(da) || !std::isfinite(dm)) return;
    alpha -= da;
    mu -= dm;
  }
}

// The rotation and scale whose first two columns are nearest to c1, c2, treating both alike.
bool frame_from_columns(const Vector3d& c1, const Vector3d& c2, Transform& out) {
  const double l1 = c1.norm(), l2 = c2.norm();
  const Vector3d sum = c1 / l1 + c2 / l2, difference = c1 / l1 - c2 / l2;
  const Vector3d e1 = sum.normalized(), e2 = difference.normalized();
  out.rotation.col(0) = (e1 + e2) * M_SQRT1_2;
  out.rotation.col(1) = (e1 - e2) * M_SQRT1_2;
  out.rotation.col(2) = out.rotation.col(0).cross(out.rotation.col(1));
  const double scale = 0.5 * (l1 + l2);
  out.scales.setConstant(scale);
  return scale > 0 && std::isfinite(out.rotation.sum()) && std::isfinite(scale);
}

}  // namespace

int four_points(const std::array<PointOnLine, 4>& problem, std::array<Transform, 4>& solutions,
                NoRealRoot policy) {
  // Centre both sides; take each line's point nearest to the centre.
  Vector2d image_centre = Vector2d::Zero();
  Vector3d centre = Vector3d::Zero();
  for (const auto& o : problem) {
    image_centre += 0.25 * o.image;
    centre += 0.25 * o.point;
  }
  std::array<Vector2d, 4> x;
  std::array<Vector3d, 4> foot;
  double size = 0, image_size = 0;
  for (int i = 0; i < 4; ++i) {
    const Vector3d from_centre = problem[i].point - centre;
    x[i] = problem[i].image - image_centre;
    foot[i] = from_centre - problem[i].direction * problem[i].direction.dot(from_centre);
    size += foot[i].norm();
    image_size += x[i].norm();
  }
  if (!(size > 0) || !(image_size > 0)) return 0;  // also refuses NaN
  for (int i = 0; i < 4; ++i) {
    foot[i] /= size;
    x[i] /= image_size;
  }

  // sum_i w_i (x_i, 1) = 0: w_i is the signed area of the triangle of the other three.
  const std::array<double, 4> w{cross(x[2] - x[1], x[3] - x[1]), -cross(x[2] - x[0], x[3] - x[0]),
                                cross(x[1] - x[0], x[3] - x[0]), -cross(x[1] - x[0], x[2] - x[0])};

  // Every point as a function of its place along its line, and of one step mu across line e, the point
  // that is held to one plane only:
  //     P_i = f_i + lambda_i d_i (+ mu m at i = e),   sum_i w_i P_i = 0.
  // The step leads out of the plane that two directions span: needles often tilt in one plane only,
  // and places along such lines alone could not close the sum.
  constexpr int e = 3;
  Vector3d across, unused;
  const Vector3d& de = problem[e].direction;
  const Vector3d out_of_plane = widest_cross(problem);
  across = out_of_plane - de * de.dot(out_of_plane);
  if (across.squaredNorm() > 1e-4 * out_of_plane.squaredNorm())
    across.normalize();
  else
    perpendicular_basis(de, across, unused);
  Eigen::Matrix<double, 3, 6> sum;
  sum.col(5).setZero();
  for (int i = 0; i < 4; ++i) {
    sum.col(i) = w[i] * problem[i].direction;
    sum.col(5) += w[i] * foot[i];
  }
  sum.col(4) = w[e] * across;
  std::array<int, 5> order{0, 1, 2, 3, 4};
  if (!eliminate(sum, order)) return 0;

  // The places (lambda, mu) are affine in the two that the elimination left free, alpha and mu below.
  std::array<Affine1, 5> places;
  places[order[3]] = {0, 1, 0};
  places[order[4]] = {0, 0, 1};
  for (int i = 0; i < 3; ++i) places[order[i]] = {-sum(i, 5), -sum(i, 3), -sum(i, 4)};
  std::array<Affine3, 4> p;
  for (int i = 0; i < 4; ++i) p[i] = along(places[i], problem[i].direction);
  for (int i = 0; i < 4; ++i) p[i].constant += foot[i];
  p[e] = p[e].combine(1.0, along(places[4], across), 1.0);

  // c1 and c2 from the three points of the largest triangle.
  int left_out = 0;
  for (int i = 1; i < 4; ++i)
    if (std::fabs(w[i]) > std::fabs(w[left_out])) left_out = i;
  const int i0 = (left_out + 1) % 4, i1 = (left_out + 2) % 4, i2 = (left_out + 3) % 4;
  const Vector2d u = x[i1] - x[i0], v = x[i2] - x[i0];
  const Affine3 du = p[i1].minus(p[i0]), dv = p[i2].minus(p[i0]);
  const double area = 1.0 / cross(u, v);
  const Affine3 c1 = du.combine(v.y() * area, dv, -u.y() * area);
  const Affine3 c2 = du.combine(-v.x() * area, dv, u.x() * area);

  const Conic f = dot(c1, c1) - dot(c2, c2), g = dot(c1, c2);
  const Elimination elimination = eliminate_mu(f, g);
  const Roots roots = quartic_roots(elimination.quartic, policy == NoRealRoot::kRealPart);

  int count = 0;
  for (int i = 0; i < roots.count; ++i) {
    double alpha = roots.value[i], mu = elimination.mu(alpha);
    if (i < roots.real_count) polish(f, g, alpha, mu);
    Transform& out = solutions[count];
    if (!frame_from_columns(c1.at(alpha, mu), c2.at(alpha, mu), out)) continue;
    out.scales *= size / image_size;
    // The translation that carries the points' centre to their images' centre.
    Vector3d mean = Vector3d::Zero();
    for (const Affine3& point : p) mean += 0.25 * point.at(alpha, mu);
    out.translation = centre + size * mean - out.linear().leftCols<2>() * image_centre;
    if (out.translation.allFinite()) ++count;
  }
  return count;
}

}  // namespace sonocal
