#include "sonocal/solvers/paper.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/small.hpp"
#include "sonocal/linalg/vectors.hpp"
#include "sonocal/solvers/linear.hpp"

namespace sonocal {
namespace {

// Lengths of order one on both sides. The paper says nothing of units; without this its SVD compares
// squared pixels with millimetres. Nothing is centred: see paper_two_lines's note in docs/theory.md.
struct Units {
  double image = 0, space = 0;
};

template <class Problem>
Units units_of(const Problem& problem) {
  Units units;
  for (const auto& o : problem) {
    units.image = std::fmax(units.image, o.image.norm());
    units.space = std::fmax(units.space, o.point.norm());
  }
  return units;
}

// Eigenvalues of so small an imaginary part may be a pair that rounding parted; polishing tells.
constexpr double kNearlyReal = 1e-2;
constexpr int kPolish = 40;
constexpr double kVanishes = 1e-11;  // quadrics of unit vectors

// The right singular vectors of all but the first seven singular values: the eighth, then the null space. The
// left ones come from the Gram matrix, and the factor Q of what they turn the rows into is orthogonal
// whatever they are off by: as good as a singular value decomposition here, in a fifth of its time.
template <int kUnknowns>
Eigen::Matrix<double, kUnknowns, kUnknowns - 7> subspace(
    const Eigen::Matrix<double, kUnknowns, 8>& transposed) {
  const Eigen::Matrix<double, 8, 8> gram = transposed.transpose().lazyProduct(transposed);
  const Eigen::Matrix<double, 8, 8> vectors = symmetric_eigen(gram).vectors;
  Eigen::Matrix<double, kUnknowns, 8> graded;
  for (int i = 0; i < 8; ++i) graded.col(i) = transposed.lazyProduct(vectors.col(7 - i));
  return orthogonal_factor<SmallMatrix>(graded).rightCols(kUnknowns - 7);
}

// Gaussian elimination with row pivoting of the first `columns` columns, downwards, of a row-major matrix.
SONOCAL_WIDEST_VECTORS void eliminate(double* m, int rows, int width, int columns) {
  for (int c = 0; c < columns; ++c) {
    int pivot = c;
    for (int r = c + 1; r < rows; ++r)
      if (std::fabs(m[r * width + c]) > std::fabs(m[pivot * width + c])) pivot = r;
    double* __restrict top = m + c * width;
    if (pivot != c) std::swap_ranges(top, top + width, m + pivot * width);
    for (int r = c + 1; r < rows; ++r) {
      double* __restrict row = m + r * width;
      const double factor = row[c] / top[c];
      if (factor == 0) continue;
#pragma omp simd
      for (int i = c; i < width; ++i) row[i] -= factor * top[i];
    }
  }
}

// -C^-1 B of a system (C B) that the last rows of an eliminated matrix hold.
template <int kC, int kB, class M>
Eigen::Matrix<double, kC, kB> back_substitute(const M& m, int first) {
  const auto c = m.template block<kC, kC>(first, first);
  const auto b = m.template block<kC, kB>(first, first + kC);
  return -c.template triangularView<Eigen::Upper>().solve(b);
}

template <int kSize>
struct Quadric {  // upper triangle of a symmetric form
  double at[kSize][kSize];
};

// x^T y, with x and y entries of A that are linear in the unknowns.
template <int kSize>
Quadric<kSize> dot(const Eigen::Matrix<double, 3, kSize>& x, const Eigen::Matrix<double, 3, kSize>& y) {
  const Eigen::Matrix<double, kSize, kSize> m = x.transpose() * y;
  Quadric<kSize> out{};
  for (int i = 0; i < kSize; ++i)
    for (int j = i; j < kSize; ++j) out.at[i][j] = i == j ? m(i, i) : m(i, j) + m(j, i);
  return out;
}
template <int kSize>
Quadric<kSize> operator-(Quadric<kSize> a, const Quadric<kSize>& b) {
  for (int i = 0; i < kSize; ++i)
    for (int j = i; j < kSize; ++j) a.at[i][j] -= b.at[i][j];
  return a;
}

// The 55 monomials of a, b, c, d, e up to the third degree without e^3, as sorted triples of factors with 5
// for the factor 1: 42 to eliminate, then eq. (15), then eq. (16).
struct Monomials {
  int column[6][6][6];

  Monomials() {
    constexpr int kA = 0, kB = 1, kC = 2, kD = 3, kE = 4, kOne = 5;
    const int last[13][3] = {{kB, kB, kB},      {kA, kB, kB},     {kB, kE, kOne},   {kB, kD, kOne},
                             {kB, kC, kOne},    {kB, kB, kOne},   {kA, kB, kOne},   {kE, kOne, kOne},
                             {kD, kOne, kOne},  {kC, kOne, kOne}, {kB, kOne, kOne}, {kA, kOne, kOne},
                             {kOne, kOne, kOne}};
    for (auto& plane : column)
      for (auto& row : plane)
        for (int& c : row) c = -1;
    for (int i = 0; i < 13; ++i) set(last[i][0], last[i][1], last[i][2], 42 + i);
    int next = 0;
    for (int i = 0; i < 6; ++i)
      for (int j = i; j < 6; ++j)
        for (int k = j; k < 6; ++k)
          if (column[i][j][k] < 0 && !(i == kE && k == kE)) set(i, j, k, next++);
  }
  void set(int i, int j, int k, int c) {
    column[i][j][k] = column[i][k][j] = column[j][i][k] = column[j][k][i] = column[k][i][j] =
        column[k][j][i] = c;
  }
};

bool finish(const Matrix3d& s, const Vector3d& t, double one, bool planar, const Units& units,
            Transform& out) {
  if (!project_to_similarity(s / one, planar, out)) return false;
  out.scales *= units.space / units.image;
  out.translation = t * (units.space / one);
  return out.scales[0] > 0 && std::isfinite(out.translation.sum());
}

// Gauss-Newton on the quadrics over vectors of length one: eliminating fifty equations has lost digits that
// the ten still hold. False where they do not vanish.
template <int kSize, int kCount>
bool polish(const Quadric<kSize> (&quadrics)[kCount], Eigen::Matrix<double, kSize, 1>& v) {
  v.normalize();
  double residual = 0;
  for (int iteration = 0; iteration < kPolish && v.allFinite(); ++iteration) {
    SmallMatrix jacobian(kCount + 1, kSize);
    SmallVector values(kCount + 1);
    for (int q = 0; q < kCount; ++q) {
      Eigen::Matrix<double, kSize, kSize> m;
      for (int i = 0; i < kSize; ++i)
        for (int j = i; j < kSize; ++j) m(i, j) = m(j, i) = (i == j ? 1.0 : 0.5) * quadrics[q].at[i][j];
      const Eigen::Matrix<double, kSize, 1> half = m * v;
      jacobian.row(q) = 2 * half.transpose();
      values[q] = v.dot(half);
    }
    jacobian.row(kCount) = v.transpose();  // no step along v, which changes nothing
    values[kCount] = 0;
    residual = values.norm() / jacobian.norm();
    if (residual < 1e-15) break;
    v -= least_squares(jacobian, values);
    v.normalize();
  }
  return residual < kVanishes && v.allFinite();
}

// Eigenvectors of an action matrix, scaled to end in 1: those that are real, or that only rounding made
// complex, and with kRealPart the real part of one of each complex pair.
template <int kSize, class Use>
void for_eigenvectors(const Eigen::Matrix<double, kSize, kSize>& action, NoRealRoot policy, const Use& use) {
  if (!action.allFinite()) return;
  const GeneralEigen eigen = general_eigen(action);
  if (!eigen.found) return;
  for (int i = 0; i < eigen.count; ++i) {
    const EigenPair& pair = eigen.pairs[i];
    const double imaginary = pair.value.imag();
    if (policy == NoRealRoot::kNothing && imaginary > kNearlyReal * std::abs(pair.value)) continue;
    // The real part of (p + i q) / (p + i q)_last.
    const double p = pair.real[kSize - 1], q = pair.imaginary[kSize - 1];
    const Eigen::Matrix<double, kSize, 1> v = (p * pair.real + q * pair.imaginary) / (p * p + q * q);
    use(v);
  }
}

// Appends a solution unless it is there already.
template <std::size_t kMost>
void append(const Transform& a, std::array<Transform, kMost>& solutions, int& count) {
  if (count == static_cast<int>(kMost)) return;
  for (int i = 0; i < count; ++i)
    if ((solutions[i].linear() - a.linear()).norm() < 1e-7 * a.linear().norm()) return;
  solutions[count++] = a;
}

// Eq. (12)-(17) in a basis of the subspace.
void append_solutions(const Eigen::Matrix<double, 13, 6>& basis, const Units& units, NoRealRoot policy,
                      std::array<Transform, 8>& solutions, int& count) {
  static const Monomials monomials;
  Eigen::Matrix<double, 3, 6> c[3], r[3];
  for (int i = 0; i < 3; ++i) {
    c[i] = basis.middleRows<3>(3 * i);
    for (int j = 0; j < 3; ++j) r[i].row(j) = basis.row(3 * j + i);
  }
  const Quadric<6> quadrics[10] = {dot<6>(c[0], c[0]) - dot<6>(c[1], c[1]),
                                   dot<6>(c[0], c[0]) - dot<6>(c[2], c[2]),
                                   dot<6>(c[0], c[1]),
                                   dot<6>(c[0], c[2]),
                                   dot<6>(c[1], c[2]),
                                   dot<6>(r[0], r[0]) - dot<6>(r[1], r[1]),
                                   dot<6>(r[0], r[0]) - dot<6>(r[2], r[2]),
                                   dot<6>(r[0], r[1]),
                                   dot<6>(r[0], r[2]),
                                   dot<6>(r[1], r[2])};
  Eigen::Matrix<double, 50, 55, Eigen::RowMajor> m;
  m.setZero();
  constexpr int kFactors[5] = {5, 0, 1, 2, 3};
  for (int q = 0; q < 10; ++q)
    for (int f = 0; f < 5; ++f)
      for (int i = 0; i < 6; ++i)
        for (int j = i; j < 6; ++j) m(5 * q + f, monomials.column[i][j][kFactors[f]]) = quadrics[q].at[i][j];
  eliminate(m.data(), 50, 55, 47);
  Eigen::Matrix<double, 8, 8> action = Eigen::Matrix<double, 8, 8>::Zero();
  action.topRows<5>() = back_substitute<5, 8>(m, 42);
  action(5, 0) = action(6, 1) = action(7, 5) = 1;  // b b = b^2, b a = ab, b 1 = b
  // Rows in the order of (16): b^2, ab, e, d, c are the first five, then b, a, 1.
  for_eigenvectors<8>(action, policy, [&](const Eigen::Matrix<double, 8, 1>& v) {
    Eigen::Matrix<double, 6, 1> unknowns;
    unknowns << v[6], v[5], v[4], v[3], v[2], 1;
    // A start for refinement needs no last digits, and the real part of a complex pair solves nothing.
    if (policy == NoRealRoot::kNothing && !polish(quadrics, unknowns)) return;
    const Eigen::Matrix<double, 13, 1> a = basis * unknowns;
    const Matrix3d s = Eigen::Map<const Matrix3d>(a.data());
    Transform found;
    if (finish(s, a.segment<3>(9), a[12], false, units, found)) append(found, solutions, count);
  });
}

}  // namespace

int paper_two_lines(const std::array<SpacePointOnLine, 4>& problem, std::array<Transform, 8>& solutions,
                    NoRealRoot policy) {
  const Units units = units_of(problem);
  Eigen::Matrix<double, 13, 8> rows;
  for (int i = 0; i < 4; ++i) {
    const Vector3d x = problem[i].image / units.image, p = problem[i].point / units.space;
    Vector3d n[2];
    perpendicular_basis(problem[i].direction, n[0], n[1]);
    for (int k = 0; k < 2; ++k)
      rows.col(2 * i + k) << x[0] * n[k], x[1] * n[k], x[2] * n[k], n[k], -n[k].dot(p);
  }
  if (!rows.allFinite()) return 0;
  const Eigen::Matrix<double, 13, 6> basis = subspace<13>(rows);

  int count = 0;
  append_solutions(basis, units, policy, solutions, count);
  return count;
}

int paper_four_points(const std::array<PointOnLine, 4>& problem, std::array<Transform, 4>& solutions,
                      NoRealRoot policy) {
  const Units units = units_of(problem);
  Eigen::Matrix<double, 10, 8> rows;
  for (int i = 0; i < 4; ++i) {
    const Vector2d x = problem[i].image / units.image;
    const Vector3d p = problem[i].point / units.space;
    Vector3d n[2];
    perpendicular_basis(problem[i].direction, n[0], n[1]);
    for (int k = 0; k < 2; ++k) rows.col(2 * i + k) << x[0] * n[k], x[1] * n[k], n[k], -n[k].dot(p);
  }
  if (!rows.allFinite()) return 0;
  const Eigen::Matrix<double, 10, 3> basis = subspace<10>(rows);
  const Eigen::Matrix<double, 3, 3> c1 = basis.topRows<3>(), c2 = basis.middleRows<3>(3);
  const Quadric<3> quadrics[2] = {dot<3>(c1, c1) - dot<3>(c2, c2), dot<3>(c1, c2)};
  // a^3 a^2b b^3 a^2 | ab^2 b^2 | ab b a 1, for products of a, b, 1 by the number of a's and b's in them.
  constexpr int kColumn[4][4] = {{9, 7, 5, 2}, {8, 6, 4, -1}, {3, 1, -1, -1}, {0, -1, -1, -1}};
  Eigen::Matrix<double, 6, 10, Eigen::RowMajor> m;
  m.setZero();
  for (int q = 0; q < 2; ++q)
    for (int f = 0; f < 3; ++f)
      for (int i = 0; i < 3; ++i)
        for (int j = i; j < 3; ++j) {
          const int as = (i == 0) + (j == 0) + (f == 0), bs = (i == 1) + (j == 1) + (f == 1);
          m(3 * q + f, kColumn[as][bs]) += quadrics[q].at[i][j];
        }
  eliminate(m.data(), 6, 10, 6);
  Matrix4d action = Matrix4d::Zero();
  action.topRows<2>() = back_substitute<2, 4>(m, 4);
  action(2, 0) = action(3, 1) = 1;  // b a = ab, b 1 = b
  int count = 0;
  for_eigenvectors<4>(action, policy, [&](const Eigen::Vector4d& v) {
    Eigen::Matrix<double, 3, 1> unknowns(v[2], v[1], 1);
    if (policy == NoRealRoot::kNothing && !polish(quadrics, unknowns)) return;
    const Eigen::Matrix<double, 10, 1> a = basis * unknowns;
    Matrix3d s = Matrix3d::Zero();
    s.col(0) = a.segment<3>(0);
    s.col(1) = a.segment<3>(3);
    Transform found;
    if (finish(s, a.segment<3>(6), a[9], true, units, found)) append(found, solutions, count);
  });
  return count;
}

}  // namespace sonocal
