// The two conics of two_conics.hpp, in lanes.
#pragma once

#include "sonocal/solvers/lanes/conics.hpp"
#include "sonocal/solvers/lanes/point_planes.hpp"
#include "sonocal/solvers/lanes/polynomial.hpp"

namespace sonocal {
namespace flat {

constexpr int kMost = 4, kRows = 7;
constexpr int kColumns = 10;  // of t, 1, c1, c2
constexpr int kLeft = 4;      // equations without t
// Turns the two unknowns: conics that miss a square because the scene is square would lose a root.
constexpr double kCosine = 0.8, kSine = 0.6;
constexpr double kSameSquares = 1e-10;

// Six numbers, c1 and c2, times reflections that were kept.
template <class T>
SONOCAL_INLINE void reflect(const T (&mirror)[kLeft][6], const T (&factor)[kLeft], T (&x)[6]) {
  for (int c = kLeft; c-- > 0;) {
    T along{};
    for (int r = c; r < 6; ++r) along += mirror[c][r] * x[r];
    along = along * factor[c];
    for (int r = c; r < 6; ++r) x[r] -= along * mirror[c][r];
  }
}

template <class T>
struct Columns {
  Affine3<T> c1, c2;
};

// All (c1, c2) with B (c1, c2) + k = 0, four equations (k, B): with B' = Q R, the least such and the two
// columns of Q that B does not see. False where the equations depend.
template <class T>
SONOCAL_INLINE Mask<T> columns_of(const T (&m)[kRows][kColumns], Columns<T>& out) {
  T b[kLeft][6], mirror[kLeft][6], factor[kLeft], x[3][6] = {};
  for (int j = 0; j < kLeft; ++j)
    for (int r = 0; r < 6; ++r) b[j][r] = m[3 + j][4 + r];
  Mask<T> independent = b[0][0] == b[0][0];
  for (int c = 0; c < kLeft; ++c) {
    T square{};
    for (int r = c; r < 6; ++r) square += b[c][r] * b[c][r];
    const T norm = with_sign<T>(sqrt(square), b[c][c]);
    independent &= square > 1e-26;
    for (int r = c; r < 6; ++r) mirror[c][r] = b[c][r];
    mirror[c][c] += norm;
    factor[c] = 1.0 / (norm * mirror[c][c]);
    // Forward substitution in R' y = -k: row c of R' has b[c][0 .. c - 1], then the diagonal.
    T right = -m[3 + c][3];
    for (int i = 0; i < c; ++i) right -= b[c][i] * x[0][i];
    x[0][c] = -right / norm;
    for (int j = c + 1; j < kLeft; ++j) {
      T along{};
      for (int r = c; r < 6; ++r) along += mirror[c][r] * b[j][r];
      along = along * factor[c];
      for (int r = c; r < 6; ++r) b[j][r] -= along * mirror[c][r];
    }
  }
  x[1][4] = x[2][5] = broadcast<T>(kCosine);
  x[1][5] = broadcast<T>(kSine);
  x[2][4] = broadcast<T>(-kSine);
  for (auto& column : x) reflect(mirror, factor, column);
  const auto half = [&](int i, int first) __attribute__((always_inline)) {
    return Vec3<T>{x[i][first], x[i][first + 1], x[i][first + 2]};
  };
  out.c1 = {half(0, 0), half(1, 0), half(2, 0)};
  out.c2 = {half(0, 3), half(1, 3), half(2, 3)};
  return independent;
}

template <class T>
SONOCAL_INLINE void finish(const Normalisation<T>& units, const T (&m)[kRows][kColumns],
                           const Columns<T>& columns, const T& alpha, const T& mu, Candidate<T>& out) {
  frame_from_columns(columns.c1.at(alpha, mu), columns.c2.at(alpha, mu), out);
  const Vec3<T> c1 = out.scale * out.column[0], c2 = out.scale * out.column[1];
  T right[3];
  for (int i = 0; i < 3; ++i)
    right[i] = m[i][3] + dot({m[i][4], m[i][5], m[i][6]}, c1) + dot({m[i][7], m[i][8], m[i][9]}, c2);
  const Mask<T> framed = out.valid;
  denormalise(units, out.scale, translation_of(m, right), out);
  out.valid &= framed;
}

// Two points on two points leave a turn about the line through them. Both conics have the same squares then,
// and two of their four common points are at infinity: the quadratic of the others, times alpha^2 + 1.
template <class T>
SONOCAL_INLINE void without_infinity(const Conic<T>& f, const Conic<T>& g, T (&quartic)[5]) {
  const T x = f.mm * g.am - g.mm * f.am, y = f.mm * g.aa - g.mm * f.aa, z = f.am * g.aa - g.am * f.aa;
  const T of_f = f.mm * f.mm + f.am * f.am + f.aa * f.aa, of_g = g.mm * g.mm + g.am * g.am + g.aa * g.aa;
  const Mask<T> same = x * x + y * y + z * z <= kSameSquares * kSameSquares * of_f * of_g;
  const T c0 = quartic[0], c1 = quartic[1], c2 = quartic[2];
  const T instead[5] = {c0, c1, c0 + c2, c1, c2};
  for (int i = 0; i < 5; ++i) quartic[i] = select(same, instead[i], quartic[i]);
}

SONOCAL_INLINE void pack(const double* points, const double* planes, int rows, int problems, bool real_parts,
                         BatchOut out) {
  PointPlane<Pack> row[kRows];
  gather_rows(points, planes, rows, problems, row);
  for (PointPlane<Pack>& one : row) one.point.z = Pack{};
  Normalisation<Pack> units;
  Pack m[kRows][kColumns];
  PackMask valid = normalise(row, 0.0, units, m);
  valid &= eliminate<3>(m);
  Columns<Pack> columns;
  valid &= columns_of(m, columns);
  const Pack one = broadcast<Pack>(1.0);
  const Conic<Pack> f = product(columns.c1.plus(one, columns.c2), columns.c1.plus(-one, columns.c2));
  const Conic<Pack> g = product(columns.c1, columns.c2);
  Elimination<Pack> elimination = eliminate_mu(f, g);
  without_infinity(f, g, elimination.quartic);
  const QuarticRoots<Pack> roots = quartic_roots(elimination.quartic);
  for (int b = 0; b < problems; ++b) out.counts[b] = 0;
  // Solutions first, then, in the first place of each complex pair, its real part.
  for (int i = 0; i < (real_parts ? 6 : 4); ++i) {
    const int at = i < 4 ? i : 2 * (i - 4);
    const PackMask wanted = valid & (i < 4 ? roots.real[at / 2] : roots.part[at / 2]);
    if (!any(wanted)) continue;
    Pack alpha = roots.value[at], mu = elimination.mu(alpha);
    if (i < 4) polish(f, g, wanted, alpha, mu);
    Candidate<Pack> candidate;
    finish(units, m, columns, alpha, mu, candidate);
    append<kMost>(candidate, wanted & candidate.valid, problems, out);
  }
  fill_rest<kMost>(problems, out);
}

}  // namespace flat

// Points (size, rows, 3) with no third coordinate and planes (size, rows, 4), rows >= 7: the first seven.
SONOCAL_INLINE void two_conics_range(const double* points, const double* planes, std::size_t size, int rows,
                                     bool real_parts, BatchOut out) {
  for (std::size_t b = 0; b < size; b += kWidth)
    flat::pack(points + b * rows * 3, planes + b * rows * 4, rows,
               size - b < kWidth ? static_cast<int>(size - b) : kWidth, real_parts,
               {out.matrices + b * 16 * flat::kMost, out.counts + b});
}

}  // namespace sonocal
