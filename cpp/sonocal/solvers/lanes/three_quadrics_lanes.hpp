// The three quadrics of three_quadrics.hpp, in lanes: problems side by side up to the polynomial, then roots.
#pragma once

#include "sonocal/solvers/lanes/lanes_io.hpp"
#include "sonocal/solvers/lanes/point_planes.hpp"
#include "sonocal/solvers/lanes/univariate.hpp"

namespace sonocal {
namespace general {

constexpr int kMost = 8;
constexpr int kColumns = 13;
// Rows of a problem, and how many of them give the translation, and the scale where it is not known.
constexpr int rows_of(bool scale_known) { return scale_known ? 6 : 7; }
constexpr int givers_of(bool scale_known) { return scale_known ? 3 : 4; }
// Roots are only where Newton on the equations starts.
constexpr double kRootTolerance = 1e-4;

// A rotation with nothing special about it, of the quaternion (8, -5, 10, 6) / 15: solutions at round angles
// would lie where two of the quaternion's components vanish, and the elimination divides by one of them.
constexpr double kTilt[3][3] = {{-47 / 225.0, -196 / 225.0, 100 / 225.0},
                                {-4 / 225.0, 103 / 225.0, 200 / 225.0},
                                {-220 / 225.0, 40 / 225.0, -25 / 225.0}};

// A row (of y, of z, of 1) of polynomials in x that vanishes at every solution.
template <class T, int A, int C>
struct PolynomialRow {
  Polynomial<T, A> y, z;
  Polynomial<T, C> one;
  SONOCAL_INLINE Vec3<T> at(const T& x) const { return {evaluate(y, x), evaluate(z, x), evaluate(one, x)}; }
};

// All that a root needs to become a solution. Numbers of T alone, so that lanes can be dealt out anew.
template <class T>
struct Problem {
  Normalisation<T> units;
  T rows[4][kColumns];     // upper triangular in t, 1
  Vec3<T> equation[3][3];  // columns of K_j: the sum of its entries times those of R, and k_j, is zero
  T constant[3];           // k_j: none where the scale is not known
  T eliminated;            // which two of the quaternion's components are y and z
  PolynomialRow<T, 2, 3> first, second;
  PolynomialRow<T, 3, 4> third;
  Polynomial<T, 8> polynomial;
};

// The three equations' coefficients of each product of two of a quaternion's components.
constexpr int kProduct[4][4] = {{0, 4, 5, 6}, {4, 1, 7, 8}, {5, 7, 2, 9}, {6, 8, 9, 3}};
template <class T>
struct Forms {
  Vec3<T> product[10];

  SONOCAL_INLINE Vec3<T>& at(int a, int b) { return product[kProduct[a][b]]; }
  SONOCAL_INLINE const Vec3<T>& at(int a, int b) const { return product[kProduct[a][b]]; }
  SONOCAL_INLINE void swap(const Mask<T>& where, int a, int b) {
    swap_where<T>(where, at(a, a), at(b, b));
    for (int c = 0; c < 4; ++c)
      if (c != a && c != b) swap_where<T>(where, at(a, c), at(b, c));
  }
};

// sum_ij K_ij S_ij(q) + k |q|^2, as quadratic forms of the quaternion w x y z.
template <class T>
SONOCAL_APART Forms<T> forms_of(const Vec3<T> (&equation)[3][3], const T (&constant)[3]) {
  Forms<T> f;
  const auto set = [&](int j, int a, int b, const T& value) __attribute__((always_inline)) {
    Vec3<T>& v = f.at(a, b);
    (j == 0 ? v.x : j == 1 ? v.y : v.z) = value;
  };
  for (int j = 0; j < 3; ++j) {
    const Vec3<T>&c0 = equation[j][0], &c1 = equation[j][1], &c2 = equation[j][2];
    set(j, 0, 0, constant[j] + c0.x + c1.y + c2.z);
    set(j, 1, 1, constant[j] + c0.x - c1.y - c2.z);
    set(j, 2, 2, constant[j] + c1.y - c0.x - c2.z);
    set(j, 3, 3, constant[j] + c2.z - c0.x - c1.y);
    set(j, 0, 1, 2.0 * (c1.z - c2.y));
    set(j, 0, 2, 2.0 * (c2.x - c0.z));
    set(j, 0, 3, 2.0 * (c0.y - c1.x));
    set(j, 1, 2, 2.0 * (c1.x + c0.y));
    set(j, 1, 3, 2.0 * (c2.x + c0.z));
    set(j, 2, 3, 2.0 * (c2.y + c1.z));
  }
  return f;
}

// Swaps of components that bring the pair `eliminated` to y and z, one after the other; back in reverse.
constexpr int kPairs[6][2] = {{2, 3}, {1, 3}, {1, 2}, {0, 3}, {0, 2}, {0, 1}};
constexpr int kSwaps[4][2] = {{1, 2}, {1, 3}, {0, 2}, {0, 3}};
template <class T>
SONOCAL_INLINE Mask<T> swaps(const T& eliminated, int swap) {
  switch (swap) {
    case 0:
      return eliminated == 1.0;
    case 1:
      return (eliminated == 2.0) | (eliminated == 5.0);
    case 2:
      return (eliminated == 3.0) | (eliminated == 5.0);
    default:
      return eliminated == 4.0;
  }
}

// The pair whose squares and product are most independent.
template <class T>
SONOCAL_APART T choose(Forms<T>& f) {
  T best = broadcast<T>(-1), out = broadcast<T>(0);
  for (int i = 0; i < 6; ++i) {
    const int y = kPairs[i][0], z = kPairs[i][1];
    const T size = abs(dot(f.at(y, y), cross(f.at(z, z), f.at(y, z))));
    out = select(size > best, broadcast<T>(i), out);
    best = larger(size, best);
  }
  return out;
}

// square = a y + b z + c for each of y^2, z^2, y z.
template <class T>
struct Reduced {
  Polynomial<T, 1> a, b;
  Polynomial<T, 2> c;
};

template <class T>
SONOCAL_APART void reduce(const Forms<T>& f, Reduced<T> (&out)[3]) {
  const Vec3<T>&yy = f.at(2, 2), &zz = f.at(3, 3), &yz = f.at(2, 3);
  const Vec3<T> crosses[3] = {cross(zz, yz), cross(yz, yy), cross(yy, zz)};
  const T unit = -1.0 / dot(yy, crosses[0]);
  for (int i = 0; i < 3; ++i) {
    const Vec3<T> row = unit * crosses[i];
    out[i].a = {{dot(row, f.at(0, 2)), dot(row, f.at(1, 2))}};
    out[i].b = {{dot(row, f.at(0, 3)), dot(row, f.at(1, 3))}};
    out[i].c = {{dot(row, f.at(0, 0)), dot(row, f.at(0, 1)), dot(row, f.at(1, 1))}};
  }
}

// The identities z y^2 = y (y z), y z^2 = z (y z), y^2 z^2 = (y z)^2, reduced again, and their determinant.
template <class T>
SONOCAL_APART void resultant(const Reduced<T> (&r)[3], Problem<T>& p) {
  const auto& [a1, b1, c1] = r[0];
  const auto& [a2, b2, c2] = r[1];
  const auto& [a3, b3, c3] = r[2];
  const auto shared = b1 * a2 - a3 * b3 - c3;
  p.first = {shared, a1 * b3 + b1 * b2 + c1 - a3 * b1 - b3 * b3, a1 * c3 + b1 * c2 - a3 * c1 - b3 * c3};
  p.second = {a2 * a1 + b2 * a3 + c2 - a3 * a3 - b3 * a2, shared, a2 * c1 + b2 * c3 - a3 * c3 - b3 * c2};
  const auto yy = a1 * a2 - a3 * a3, zz = b1 * b2 - b3 * b3;
  const auto half_a = a3 + a3, half_b = b3 + b3;
  const auto yz = a1 * b2 + b1 * a2 - half_a * b3;
  const auto y = a1 * c2 + c1 * a2 - half_a * c3, z = b1 * c2 + c1 * b2 - half_b * c3;
  p.third = {yy * a1 + zz * a2 + yz * a3 + y, yy * b1 + zz * b2 + yz * b3 + z,
             yy * c1 + zz * c2 + yz * c3 + c1 * c2 - c3 * c3};
  p.polynomial = (p.first.y * p.second.z - p.first.z * p.second.y) * p.third.one +
                 (p.first.z * p.second.one - p.first.one * p.second.z) * p.third.y +
                 (p.first.one * p.second.y - p.first.y * p.second.one) * p.third.z;
}

// Up to the polynomial; true where there is one. The scale is mm per px, where it is known.
template <bool kScaleKnown, class T>
SONOCAL_INLINE Mask<T> prepare(const PointPlane<T> (&row)[rows_of(kScaleKnown)], double scale,
                               Problem<T>& p) {
  constexpr int kGivers = givers_of(kScaleKnown);
  T m[rows_of(kScaleKnown)][kColumns];
  Mask<T> valid = normalise(row, kScaleKnown ? scale : 0.0, p.units, m);
  valid &= eliminate<kGivers>(m);
  for (int r = 0; r < 4; ++r)
    for (int k = 0; k < kColumns; ++k) p.rows[r][k] = m[r][k];
  for (int j = 0; j < 3; ++j) {
    const T(&k)[kColumns] = m[kGivers + j];
    const Vec3<T> c0{k[4], k[5], k[6]}, c1{k[7], k[8], k[9]}, c2{k[10], k[11], k[12]};
    for (int c = 0; c < 3; ++c)  // K . (R tilt^T) = (K tilt) . R
      p.equation[j][c] =
          broadcast<T>(kTilt[0][c]) * c0 + broadcast<T>(kTilt[1][c]) * c1 + broadcast<T>(kTilt[2][c]) * c2;
    p.constant[j] = kScaleKnown ? k[3] : T{};
  }
  Forms<T> forms = forms_of(p.equation, p.constant);
  p.eliminated = choose(forms);
  for (int i = 0; i < 4; ++i) forms.swap(swaps(p.eliminated, i), kSwaps[i][0], kSwaps[i][1]);
  Reduced<T> reduced[3];
  reduce(forms, reduced);
  resultant(reduced, p);
  return valid;
}

template <class T>
struct Quaternion {
  T w;
  Vec3<T> v;

  SONOCAL_INLINE T& at(int i) { return i == 0 ? w : i == 1 ? v.x : i == 2 ? v.y : v.z; }
  SONOCAL_INLINE void normalise() {
    const T unit = 1.0 / sqrt(w * w + dot(v, v));
    w = unit * w;
    v = unit * v;
  }
  SONOCAL_INLINE void columns(Vec3<T> (&out)[3]) const {
    const T x2 = v.x + v.x, y2 = v.y + v.y, z2 = v.z + v.z;
    const T xx = v.x * x2, yy = v.y * y2, zz = v.z * z2, xy = v.x * y2, xz = v.x * z2, yz = v.y * z2;
    const T wx = w * x2, wy = w * y2, wz = w * z2;
    out[0] = {1.0 - (yy + zz), xy + wz, xz - wy};
    out[1] = {xy - wz, 1.0 - (xx + zz), yz + wx};
    out[2] = {xz + wy, yz - wx, 1.0 - (xx + yy)};
  }
};

// The quaternion at a root: y and z from the two rows that say most.
template <class T>
SONOCAL_APART Quaternion<T> quaternion_at(const Problem<T>& p, const T& x) {
  const T unit = 1.0 / (1.0 + x * x);
  const Vec3<T> a = unit * p.first.at(x), b = unit * p.second.at(x), c = (unit * unit) * p.third.at(x);
  Vec3<T> best = cross(a, b);
  const Vec3<T> others[2] = {cross(b, c), cross(c, a)};
  for (const Vec3<T>& other : others) best = select_vec(dot(other, other) > dot(best, best), other, best);
  Quaternion<T> q{best.z, {x * best.z, best.x, best.y}};
  for (int i = 4; i-- > 0;) swap_where<T>(swaps(p.eliminated, i), q.at(kSwaps[i][0]), q.at(kSwaps[i][1]));
  q.normalise();
  return q;
}

// Newton on the three equations over rotations: d/dw of K . exp([w]) R is sum_c r_c x k_c. The polynomial
// has lost digits that the equations still hold. True where it came to rest.
template <class T>
SONOCAL_APART Mask<T> polish(const Vec3<T> (&equation)[3][3], const T (&constant)[3], Mask<T> going,
                             Quaternion<T>& q) {
  T last = broadcast<T>(1);
  for (int iteration = 0; iteration < 5 && any(going); ++iteration) {
    Vec3<T> r[3], row[3];
    q.columns(r);
    T residual[3];
    for (int j = 0; j < 3; ++j) {
      const Vec3<T>(&k)[3] = equation[j];
      row[j] = cross(r[0], k[0]) + cross(r[1], k[1]) + cross(r[2], k[2]);
      residual[j] = dot(r[0], k[0]) + dot(r[1], k[1]) + dot(r[2], k[2]) + constant[j];
    }
    const Vec3<T> c0 = cross(row[1], row[2]);
    const Vec3<T> step = (-0.5 / dot(row[0], c0)) * (residual[0] * c0 + residual[1] * cross(row[2], row[0]) +
                                                     residual[2] * cross(row[0], row[1]));
    const T moved = dot(step, step);
    going &= moved <= 1.0;
    Quaternion<T> next{q.w - dot(step, q.v), q.v + q.w * step + cross(step, q.v)};
    next.normalise();
    q = {select(going, next.w, q.w), select_vec(going, next.v, q.v)};
    last = select(going, moved, last);
    going &= moved >= 1e-15;  // the next step would be of its square
  }
  return last < 1e-12;
}

// The fourth row gives the scale where it is not known, the first three the translation.
template <bool kScaleKnown, class T>
SONOCAL_APART void finish(const Problem<T>& p, const Quaternion<T>& q, Candidate<T>& out) {
  Vec3<T> r[3];
  q.columns(r);
  for (int c = 0; c < 3; ++c)
    out.column[c] = broadcast<T>(kTilt[c][0]) * r[0] + broadcast<T>(kTilt[c][1]) * r[1] +
                    broadcast<T>(kTilt[c][2]) * r[2];
  T times_s[4];
  for (int i = 0; i < givers_of(kScaleKnown); ++i) {
    const T(&m)[kColumns] = p.rows[i];
    times_s[i] = dot({m[4], m[5], m[6]}, out.column[0]) + dot({m[7], m[8], m[9]}, out.column[1]) +
                 dot({m[10], m[11], m[12]}, out.column[2]);
  }
  const T scale = kScaleKnown ? broadcast<T>(1) : -p.rows[3][3] / times_s[3];
  T right[3];
  for (int i = 0; i < 3; ++i) right[i] = scale * times_s[i] + p.rows[i][3];
  denormalise(p.units, scale, translation_of(p.rows, right), out);
}

// The problems of other lanes, one for each root.
SONOCAL_APART Problem<Pack> deal(const Problem<Pack>& p, const PackMask& lane) {
  constexpr int kNumbers = sizeof(Problem<Pack>) / sizeof(Pack);
  Pack numbers[kNumbers];
  std::memcpy(numbers, &p, sizeof p);
  for (Pack& x : numbers) x = from_lanes(x, lane);
  Problem<Pack> out;
  std::memcpy(&out, numbers, sizeof out);
  return out;
}

// Solutions at the roots of the polynomial, or, with `between`, where |p| has a minimum above zero: near the
// real part of a complex pair that noise has parted.
template <bool kScaleKnown, int N>
SONOCAL_INLINE void append_roots(const Problem<Pack>& problem, const Polynomial<Pack, N>& p,
                                 const PackMask& valid, bool between, int problems, BatchOut out) {
  Brackets<N> brackets;
  real_roots(p, valid, problems, brackets);
  for (int i = 0; i < kWidth; ++i) {  // the last pack reads past the last root
    brackets.low[brackets.count + i] = brackets.high[brackets.count + i] = 0;
    brackets.lane[brackets.count + i] = brackets.negative_low[brackets.count + i] = 0;
  }
  for (int first = 0; first < brackets.count; first += kWidth) {
    const int roots = brackets.count - first < kWidth ? brackets.count - first : kWidth;
    const PackMask lane = load(brackets.lane + first);
    const Problem<Pack> own = problems == 1 ? problem : deal(problem, lane);
    Polynomial<Pack, N> own_p;
    for (int i = 0; i <= N; ++i) own_p.c[i] = from_lanes(p.c[i], lane);
    const Pack x = root_in(own_p, load(brackets.low + first), load(brackets.high + first),
                           load(brackets.negative_low + first), kRootTolerance);
    PackMask wanted = x == x;
    if (between) wanted &= evaluate(derivative(own_p), x) * evaluate(own.polynomial, x) > 0.0;
    Quaternion<Pack> q = quaternion_at(own, x);
    if (!between) wanted &= polish(own.equation, own.constant, wanted, q);
    Candidate<Pack> candidate;
    finish<kScaleKnown>(own, q, candidate);
    append<kMost>(candidate, wanted & candidate.valid, lane, roots, out);
  }
}

template <bool kScaleKnown>
SONOCAL_INLINE void pack(const double* points, const double* planes, int rows, double scale, int problems,
                         bool real_parts, BatchOut out) {
  PointPlane<Pack> row[rows_of(kScaleKnown)];
  gather_rows(points, planes, rows, problems, row);
  Problem<Pack> problem;
  const PackMask valid = prepare<kScaleKnown>(row, scale, problem);
  for (int b = 0; b < problems; ++b) out.counts[b] = 0;
  append_roots<kScaleKnown>(problem, problem.polynomial, valid, false, problems, out);
  if (real_parts)
    append_roots<kScaleKnown>(problem, derivative(problem.polynomial), valid, true, problems, out);
  fill_rest<kMost>(problems, out);
}

template <bool kScaleKnown>
SONOCAL_INLINE void range(const double* points, const double* planes, std::size_t size, int rows,
                          double scale, bool real_parts, BatchOut out) {
  for (std::size_t b = 0; b < size; b += kWidth)
    pack<kScaleKnown>(points + b * rows * 3, planes + b * rows * 4, rows, scale,
                      size - b < kWidth ? static_cast<int>(size - b) : kWidth, real_parts,
                      {out.matrices + b * 16 * kMost, out.counts + b});
}

}  // namespace general

// Points (size, rows, 3) and planes (size, rows, 4): the first seven are solved, or the first six where the
// scale > 0 is known.
SONOCAL_INLINE void three_quadrics_range(const double* points, const double* planes, std::size_t size,
                                         int rows, double scale, bool real_parts, BatchOut out) {
  if (scale > 0)
    general::range<true>(points, planes, size, rows, scale, real_parts, out);
  else
    general::range<false>(points, planes, size, rows, scale, real_parts, out);
}

}  // namespace sonocal
