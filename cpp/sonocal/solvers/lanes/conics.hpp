// Two conics in two unknowns, and the frame that two columns span.
#pragma once

#include "sonocal/solvers/lanes/lanes.hpp"

namespace sonocal {

// A 3-vector that is affine in the two unknowns: constant + alpha * a + mu * m.
template <class T>
struct Affine3 {
  Vec3<T> constant, a, m;

  SONOCAL_INLINE Affine3 plus(const T& weight, const Affine3& o) const {
    return {constant + weight * o.constant, a + weight * o.a, m + weight * o.m};
  }
  SONOCAL_INLINE Affine3 times(const T& weight) const { return {weight * constant, weight * a, weight * m}; }
  SONOCAL_INLINE Vec3<T> at(const T& alpha, const T& mu) const { return constant + alpha * a + mu * m; }
};

// mm mu^2 + am alpha mu + m mu + aa alpha^2 + a alpha + one
template <class T>
struct Conic {
  T mm, am, m, aa, a, one;

  SONOCAL_INLINE T at(const T& alpha, const T& mu) const {
    return mu * (mm * mu + am * alpha + m) + alpha * (aa * alpha + a) + one;
  }
  SONOCAL_INLINE T by_alpha(const T& alpha, const T& mu) const { return am * mu + 2.0 * aa * alpha + a; }
  SONOCAL_INLINE T by_mu(const T& alpha, const T& mu) const { return 2.0 * mm * mu + am * alpha + m; }
};

template <class T>
SONOCAL_INLINE Conic<T> product(const Affine3<T>& x, const Affine3<T>& y) {
  return {dot(x.m, y.m),
          dot(x.a, y.m) + dot(x.m, y.a),
          dot(x.constant, y.m) + dot(x.m, y.constant),
          dot(x.a, y.a),
          dot(x.constant, y.a) + dot(x.a, y.constant),
          dot(x.constant, y.constant)};
}

// Eliminates mu from two conics: mu = -constant(alpha) / slope(alpha), and the quartic in alpha.
template <class T>
struct Elimination {
  T constant[3], slope[2], quartic[5];

  SONOCAL_INLINE T mu(const T& alpha) const {
    return -(constant[0] + alpha * (constant[1] + alpha * constant[2])) / (slope[0] + alpha * slope[1]);
  }
};

template <class T>
SONOCAL_INLINE Elimination<T> eliminate_mu(const Conic<T>& f, const Conic<T>& g) {
  const T s0 = f.mm * g.m - g.mm * f.m, s1 = f.mm * g.am - g.mm * f.am;
  const T c0 = f.mm * g.one - g.mm * f.one, c1 = f.mm * g.a - g.mm * f.a, c2 = f.mm * g.aa - g.mm * f.aa;
  // slope (f1 g0 - g1 f0) - constant^2, with f1, f0 the coefficients of mu and 1 in f.
  const T x0 = f.m * g.one - g.m * f.one, x1 = f.am * g.one + f.m * g.a - g.am * f.one - g.m * f.a;
  const T x2 = f.am * g.a + f.m * g.aa - g.am * f.a - g.m * f.aa, x3 = f.am * g.aa - g.am * f.aa;
  return {{c0, c1, c2},
          {s0, s1},
          {s0 * x0 - c0 * c0, s0 * x1 + s1 * x0 - 2.0 * c0 * c1, s0 * x2 + s1 * x1 - 2.0 * c0 * c2 - c1 * c1,
           s0 * x3 + s1 * x2 - 2.0 * c1 * c2, s1 * x3 - c2 * c2}};
}

// Newton on both conics at once: the quartic's roots have lost digits that the conics still hold.
template <class T>
SONOCAL_INLINE void polish(const Conic<T>& f, const Conic<T>& g, const Mask<T>& where, T& alpha, T& mu) {
  for (int iteration = 0; iteration < 2; ++iteration) {
    const T fa = f.by_alpha(alpha, mu), fm = f.by_mu(alpha, mu);
    const T ga = g.by_alpha(alpha, mu), gm = g.by_mu(alpha, mu);
    const T f0 = f.at(alpha, mu), g0 = g.at(alpha, mu);
    const T inverse = 1.0 / (fa * gm - fm * ga);
    const T da = (f0 * gm - g0 * fm) * inverse, dm = (fa * g0 - ga * f0) * inverse;
    const Mask<T> sound = where & finite(da + dm);
    alpha = select(sound, alpha - da, alpha);
    mu = select(sound, mu - dm, mu);
  }
}

// The rotation and scale whose first two columns are nearest to c1, c2: the polar decomposition of the
// 3 x 2 matrix, with (C^T C)^(1/2) in closed form. The scale is the mean singular value.
template <class T>
SONOCAL_INLINE void frame_from_columns(Vec3<T> c1, Vec3<T> c2, Candidate<T>& out) {
  // Far from orthogonal columns lose digits in their sums; a second round restores them, there alone: what a
  // lane gives must not depend on its neighbours.
  Mask<T> rough{};
  for (int round = 0; round < 2; ++round) {
    const T a = dot(c1, c1), b = dot(c2, c2), g = dot(c1, c2);
    const T root = sqrt<T>(a * b - g * g), trace = sqrt<T>(a + b + 2.0 * root);
    const T inverse = 1.0 / (root * trace);
    const Vec3<T> r1 = (inverse * (b + root)) * c1 - (inverse * g) * c2;
    const Vec3<T> r2 = (inverse * (a + root)) * c2 - (inverse * g) * c1;
    c1 = round == 0 ? r1 : select_vec(rough, r1, c1);
    c2 = round == 0 ? r2 : select_vec(rough, r2, c2);
    if (round == 1) break;
    out.scale = 0.5 * trace;
    rough = abs(a - b) + abs(g) > 1e-3 * root;
    if (!any(rough)) break;
  }
  out.column[0] = c1;
  out.column[1] = c2;
  out.column[2] = cross(c1, c2);
  out.valid = (out.scale > 0.0) & finite(c1.x + c1.y + c1.z + c2.x + c2.y + c2.z);
}

}  // namespace sonocal
