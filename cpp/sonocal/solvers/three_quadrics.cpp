#include "sonocal/solvers/three_quadrics.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "sonocal/solvers/sturm.hpp"

namespace sonocal {
namespace {

using Rows = Eigen::Matrix<double, 7, 13>;  // t, 1, then the columns of S
using Equation = Matrix3d;                  // sum of its entries times those of S is zero
using Form = std::array<double, 10>;        // ww xx yy zz wx wy wz xy xz yz of a quaternion
using Quaternion = Eigen::Vector4d;         // w x y z

constexpr int kForm[4][4] = {{0, 4, 5, 6}, {4, 1, 7, 8}, {5, 7, 2, 9}, {6, 8, 9, 3}};

// Roots are only where Newton on the equations starts.
constexpr double kRootTolerance = 1e-4;

// A rotation with nothing special about it: solutions at round angles would lie where two of the
// quaternion's components vanish, and the elimination divides by one of them.
const Matrix3d kTilt = Eigen::Quaterniond(0.58, -0.35, 0.67, 0.29).normalized().toRotationMatrix();

// Householder reflections that clear the first four columns below the diagonal; false where they depend.
bool eliminate(Rows& m) {
  for (int c = 0; c < 4; ++c) {
    const double below = m.col(c).tail(6 - c).squaredNorm();
    const double norm = std::sqrt(m(c, c) * m(c, c) + below);
    if (!(norm > 1e-13)) return false;
    const double sign = m(c, c) < 0 ? -1.0 : 1.0;
    const double head = m(c, c) + sign * norm;
    const double factor = 1.0 / (sign * norm * head);
    for (int k = c + 1; k < 13; ++k) {
      double dot = head * m(c, k);
      for (int r = c + 1; r < 7; ++r) dot += m(r, c) * m(r, k);
      dot *= factor;
      m(c, k) -= dot * head;
      for (int r = c + 1; r < 7; ++r) m(r, k) -= dot * m(r, c);
    }
    m(c, c) = -sign * norm;
  }
  return true;
}

// sum_ij K_ij S_ij(q), as a quadratic form of the quaternion.
Form form_of(const Equation& k) {
  return {k(0, 0) + k(1, 1) + k(2, 2),  k(0, 0) - k(1, 1) - k(2, 2), -k(0, 0) + k(1, 1) - k(2, 2),
          -k(0, 0) - k(1, 1) + k(2, 2), 2 * (k(2, 1) - k(1, 2)),     2 * (k(0, 2) - k(2, 0)),
          2 * (k(1, 0) - k(0, 1)),      2 * (k(0, 1) + k(1, 0)),     2 * (k(0, 2) + k(2, 0)),
          2 * (k(1, 2) + k(2, 1))};
}

// Which components of q play which part: y and z are eliminated, x stays, w is set to 1.
struct Parts {
  int w, x, y, z;
};

Parts choose(const std::array<Form, 3>& forms) {
  constexpr Parts kAll[6] = {{0, 1, 2, 3}, {0, 2, 1, 3}, {0, 3, 1, 2},
                             {1, 2, 0, 3}, {1, 3, 0, 2}, {2, 3, 0, 1}};
  double best = -1;
  Parts out = kAll[0];
  for (const Parts& p : kAll) {
    Matrix3d m;
    for (int i = 0; i < 3; ++i)
      m.row(i) << forms[i][kForm[p.y][p.y]], forms[i][kForm[p.z][p.z]], forms[i][kForm[p.y][p.z]];
    const double size = std::fabs(m.determinant());
    if (size > best) {
      best = size;
      out = p;
    }
  }
  return out;
}

// A row (of y, of z, of 1) of polynomials in x that vanishes at every solution.
template <int A, int C>
struct PolynomialRow {
  Polynomial<A> y, z;
  Polynomial<C> one;
  Vector3d at(double x) const { return {evaluate(y, x), evaluate(z, x), evaluate(one, x)}; }
};

// square = a y + b z + c for each of y^2, z^2, y z.
struct Reduced {
  Polynomial<1> a, b;
  Polynomial<2> c;
};

struct Resultant {
  PolynomialRow<2, 3> first, second;
  PolynomialRow<3, 4> third;
  Polynomial<8> polynomial() const;
};

std::array<Reduced, 3> reduce(const std::array<Form, 3>& forms, const Parts& p) {
  Matrix3d m;
  Eigen::Matrix<double, 3, 7> rest;
  for (int i = 0; i < 3; ++i) {
    const auto f = [&](int a, int b) { return forms[i][kForm[a][b]]; };
    m.row(i) << f(p.y, p.y), f(p.z, p.z), f(p.y, p.z);
    rest.row(i) << f(p.w, p.y), f(p.x, p.y), f(p.w, p.z), f(p.x, p.z), f(p.w, p.w), f(p.w, p.x), f(p.x, p.x);
  }
  Matrix3d inverse;
  inverse.row(0) = m.col(1).cross(m.col(2));
  inverse.row(1) = m.col(2).cross(m.col(0));
  inverse.row(2) = m.col(0).cross(m.col(1));
  const Eigen::Matrix<double, 3, 7> k = inverse * rest * (-1.0 / inverse.row(0).dot(m.col(0)));
  std::array<Reduced, 3> out;
  for (int i = 0; i < 3; ++i) out[i] = {{k(i, 0), k(i, 1)}, {k(i, 2), k(i, 3)}, {k(i, 4), k(i, 5), k(i, 6)}};
  return out;
}

// The identities z y^2 = y (y z), y z^2 = z (y z), y^2 z^2 = (y z)^2, reduced again.
Resultant resultant(const std::array<Reduced, 3>& r) {
  const auto& [a1, b1, c1] = r[0];
  const auto& [a2, b2, c2] = r[1];
  const auto& [a3, b3, c3] = r[2];
  const auto m = [](const auto& x, const auto& y) { return multiply(x, y); };
  const auto shared = plus(plus(m(b1, a2), m(a3, b3), -1), c3, -1);
  Resultant out;
  out.first.y = shared;
  out.first.z = plus(plus(plus(plus(m(a1, b3), m(b1, b2)), c1), m(a3, b1), -1), m(b3, b3), -1);
  out.first.one = plus(plus(plus(m(a1, c3), m(b1, c2)), m(a3, c1), -1), m(b3, c3), -1);
  out.second.y = plus(plus(plus(plus(m(a2, a1), m(b2, a3)), c2), m(a3, a3), -1), m(b3, a2), -1);
  out.second.z = shared;
  out.second.one = plus(plus(plus(m(a2, c1), m(b2, c3)), m(a3, c3), -1), m(b3, c2), -1);
  const auto yy = plus(m(a1, a2), m(a3, a3), -1), zz = plus(m(b1, b2), m(b3, b3), -1);
  const auto yz = plus(plus(m(a1, b2), m(b1, a2)), m(a3, b3), -2);
  const auto y = plus(plus(m(a1, c2), m(c1, a2)), m(a3, c3), -2);
  const auto z = plus(plus(m(b1, c2), m(c1, b2)), m(b3, c3), -2);
  const auto one = plus(m(c1, c2), m(c3, c3), -1);
  out.third.y = plus(plus(plus(m(yy, a1), m(zz, a2)), m(yz, a3)), y);
  out.third.z = plus(plus(plus(m(yy, b1), m(zz, b2)), m(yz, b3)), z);
  out.third.one = plus(plus(plus(m(yy, c1), m(zz, c2)), m(yz, c3)), one);
  return out;
}

Polynomial<8> Resultant::polynomial() const {
  const auto m = [](const auto& x, const auto& y) { return multiply(x, y); };
  const auto yz = plus(m(first.y, second.z), m(first.z, second.y), -1);
  const auto zo = plus(m(first.z, second.one), m(first.one, second.z), -1);
  const auto oy = plus(m(first.one, second.y), m(first.y, second.one), -1);
  return plus(plus(m(yz, third.one), m(zo, third.y)), m(oy, third.z));
}

// The quaternion at a root: y and z from the two rows that say most.
Quaternion quaternion_at(const Resultant& r, const Parts& p, double x) {
  const double unit = 1.0 / (1.0 + x * x);
  const Vector3d a = r.first.at(x) * unit, b = r.second.at(x) * unit, c = r.third.at(x) * (unit * unit);
  const Vector3d crosses[3] = {a.cross(b), b.cross(c), c.cross(a)};
  int best = 0;
  for (int i = 1; i < 3; ++i)
    if (crosses[i].squaredNorm() > crosses[best].squaredNorm()) best = i;
  const Vector3d& v = crosses[best];
  Quaternion q;
  q[p.w] = v.z();
  q[p.x] = x * v.z();
  q[p.y] = v.x();
  q[p.z] = v.y();
  return q.normalized();
}

Matrix3d rotation_of(const Quaternion& q) {
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
}

// Newton on the three equations over rotations: d/dw of K . exp([w]) R is sum_c r_c x k_c. The polynomial
// has lost digits that the equations still hold.
bool polish(const std::array<Equation, 3>& equations, Quaternion& q, Matrix3d& rotation) {
  double last = 1;
  for (int iteration = 0; iteration < 5; ++iteration) {
    rotation = rotation_of(q);
    Matrix3d jacobian;
    Vector3d residual;
    for (int j = 0; j < 3; ++j) {
      const Equation& k = equations[j];
      Vector3d row = rotation.col(0).cross(k.col(0)) + rotation.col(1).cross(k.col(1));
      row += rotation.col(2).cross(k.col(2));
      jacobian.row(j) = row;
      residual[j] = rotation.cwiseProduct(k).sum();
    }
    const Vector3d r0 = jacobian.row(0), r1 = jacobian.row(1), r2 = jacobian.row(2);
    const Vector3d c0 = r1.cross(r2);
    const Vector3d step =
        (residual[0] * c0 + residual[1] * r2.cross(r0) + residual[2] * r0.cross(r1)) / (-2.0 * r0.dot(c0));
    const double moved = step.squaredNorm();
    if (!std::isfinite(moved) || moved > 1) return last < 1e-12;
    const Vector3d v = q.tail<3>();
    const double w = q[0];
    q[0] -= step.dot(v);
    q.tail<3>() += w * step + step.cross(v);
    q.normalize();
    last = moved;
    if (moved < 1e-15) break;  // the next step would be of its square
  }
  rotation = rotation_of(q);
  return last < 1e-12;
}

// Where |p| has a minimum above zero: near the real part of a complex pair that noise has parted.
int near_roots(const Polynomial<8>& p, double* out) {
  Polynomial<7> slope;
  for (int i = 0; i < 8; ++i) slope[i] = (i + 1) * p[i + 1];
  std::array<double, 7> extrema;
  const int found = real_roots<7>(slope, kRootTolerance, extrema.data());
  int count = 0;
  for (int i = 0; i < found; ++i) {
    double bend = 0;
    for (int k = 8; k >= 2; --k) bend = bend * extrema[i] + k * (k - 1) * p[k];
    if (bend * evaluate(p, extrema[i]) > 0) out[count++] = extrema[i];
  }
  return count;
}

// Centres both sides and scales them to order one: what the elimination sees.
struct Scaling {
  Vector3d image_centre = Vector3d::Zero(), centre = Vector3d::Zero();
  double image_size = 0, size = 0;
};

bool rows_of(const std::array<PointOnPlane, 7>& problem, Rows& m, Scaling& scaling) {
  Matrix3d normals = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const auto& row : problem) {
    scaling.image_centre += row.point / 7.0;
    normals += row.normal * row.normal.transpose();
    right -= row.offset * row.normal;
  }
  // The point nearest to all planes.
  Matrix3d adjoint;
  adjoint.col(0) = normals.col(1).cross(normals.col(2));
  adjoint.col(1) = normals.col(2).cross(normals.col(0));
  adjoint.col(2) = normals.col(0).cross(normals.col(1));
  scaling.centre = adjoint * right / adjoint.col(0).dot(normals.col(0));
  if (!std::isfinite(scaling.centre.sum())) return false;
  std::array<double, 7> offsets;
  for (int i = 0; i < 7; ++i) {
    offsets[i] = problem[i].offset + problem[i].normal.dot(scaling.centre);
    scaling.size += std::fabs(offsets[i]);
    scaling.image_size =
        std::fmax(scaling.image_size, (problem[i].point - scaling.image_centre).squaredNorm());
  }
  scaling.image_size = std::sqrt(scaling.image_size);
  if (!(scaling.size > 0) || !(scaling.image_size > 0)) return false;
  for (int i = 0; i < 7; ++i) {
    const Vector3d x = (problem[i].point - scaling.image_centre) / scaling.image_size;
    const Vector3d& n = problem[i].normal;
    m.row(i) << n.transpose(), offsets[i] / scaling.size, x[0] * n.transpose(), x[1] * n.transpose(),
        x[2] * n.transpose();
  }
  return true;
}

}  // namespace

SONOCAL_CLONES int three_quadrics(const std::array<PointOnPlane, 7>& problem,
                                  std::array<Transform, 8>& solutions, NoRealRoot policy) {
  Rows m;
  Scaling scaling;
  if (!rows_of(problem, m, scaling) || !eliminate(m)) return 0;
  std::array<Equation, 3> equations;
  std::array<Form, 3> forms;
  for (int j = 0; j < 3; ++j) {
    Equation k;
    k << m.block<1, 3>(4 + j, 4).transpose(), m.block<1, 3>(4 + j, 7).transpose(),
        m.block<1, 3>(4 + j, 10).transpose();
    equations[j] = k * kTilt;  // k . (R T^T) = (k T) . R
    forms[j] = form_of(equations[j]);
  }
  const Parts parts = choose(forms);
  const Resultant eliminated = resultant(reduce(forms, parts));
  std::array<double, 16> roots;
  const Polynomial<8> polynomial = eliminated.polynomial();
  const int real = real_roots<8>(polynomial, kRootTolerance, roots.data());
  int found = real;
  if (policy == NoRealRoot::kRealPart) found += near_roots(polynomial, roots.data() + real);
  int count = 0;
  for (int i = 0; i < found && count < 8; ++i) {
    Quaternion q = quaternion_at(eliminated, parts, roots[i]);
    Matrix3d tilted;
    if (i < real) {
      if (!polish(equations, q, tilted)) continue;
    } else {
      tilted = rotation_of(q);
    }
    Transform& out = solutions[count];
    out.rotation = tilted * kTilt.transpose();
    // The fourth row gives the scale, the first three the translation.
    const auto times_s = [&](int r) {
      return m.block<1, 3>(r, 4).dot(out.rotation.col(0)) + m.block<1, 3>(r, 7).dot(out.rotation.col(1)) +
             m.block<1, 3>(r, 10).dot(out.rotation.col(2));
    };
    const double scale = -m(3, 3) / times_s(3);
    if (!(scale > 0) || !std::isfinite(scale)) continue;
    Vector3d t;
    for (int r = 2; r >= 0; --r) {
      double sum = scale * times_s(r) + m(r, 3);
      for (int c = r + 1; c < 3; ++c) sum += m(r, c) * t[c];
      t[r] = -sum / m(r, r);
    }
    out.scales.setConstant(scale * scaling.size / scaling.image_size);
    out.translation =
        scaling.centre + scaling.size * t - out.scales[0] * (out.rotation * scaling.image_centre);
    if (std::isfinite(out.translation.sum())) ++count;
  }
  return count;
}

void three_quadrics_batch(const double* points, const double* planes, std::size_t size, int rows,
                          NoRealRoot policy, int threads, BatchOut out) {
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    std::array<PointOnPlane, 7> problem;
    solve_each<8>(begin, end, out, [&](std::size_t b, std::array<Transform, 8>& solutions) {
      for (int i = 0; i < 7; ++i) problem[i] = read_row(points, planes, b * rows + i);
      return three_quadrics(problem, solutions, policy);
    });
  });
}

}  // namespace sonocal
