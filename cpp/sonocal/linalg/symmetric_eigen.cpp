#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "sonocal/linalg/reflection.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

constexpr int kMostSteps = 30;  // for each value

// Diagonal and the one below it of Q' A Q, and Q in A's place where it is wanted.
struct Tridiagonal {
  int size;
  double diagonal[kMostSide], below[kMostSide];
};

// Reflections from both sides, which leave zeros below the second diagonal.
Tridiagonal tridiagonalise(SmallMatrix& a, bool vectors) {
  const int n = static_cast<int>(a.rows());
  Tridiagonal t{n, {}, {}};
  double tau[kMostSide], w[kMostSide];
  for (int k = 0; k + 1 < n; ++k) {
    const int rest = n - k - 1;
    double* v = &a(k + 1, k);
    tau[k] = reflect(v, rest);
    t.below[k] = v[0];
    v[0] = 1;
    // A becomes A - v w' - w v' with w = p - (tau p.v / 2) v, p = tau A v.
    std::fill_n(w, rest, 0.0);
    double along = 0;
    for (int j = 0; j < rest; ++j) {
      w[j] += a(k + 1 + j, k + 1 + j) * v[j];
      for (int i = j + 1; i < rest; ++i) {
        w[i] += a(k + 1 + i, k + 1 + j) * v[j];
        w[j] += a(k + 1 + i, k + 1 + j) * v[i];
      }
    }
    for (int i = 0; i < rest; ++i) along += (w[i] *= tau[k]) * v[i];
    for (int i = 0; i < rest; ++i) w[i] -= 0.5 * tau[k] * along * v[i];
    for (int j = 0; j < rest; ++j)
      for (int i = j; i < rest; ++i) a(k + 1 + i, k + 1 + j) -= v[i] * w[j] + w[i] * v[j];
  }
  for (int k = 0; k < n; ++k) t.diagonal[k] = a(k, k);
  if (!vectors) return t;
  SmallMatrix q(n, n);
  q.setIdentity();
  for (int k = n - 2; k >= 0; --k)
    for (int c = k + 1; c < n; ++c) apply_reflection(&a(k + 1, k), tau[k], &q(k + 1, c), n - k - 1);
  a = q;
  return t;
}

// c and s of the rotation that turns (x, z) into (+-length, 0).
std::pair<double, double> rotation(double x, double z) {
  const double length = std::hypot(x, z);
  return {x / length, -z / length};
}

// One implicit QR step with Wilkinson's shift on the part from begin to end (Golub and Van Loan, 8.3).
void step(Tridiagonal& t, int begin, int end, double* q) {
  double *d = t.diagonal, *e = t.below;
  const double half = 0.5 * (d[end - 1] - d[end]), last = e[end - 1], root = std::hypot(half, last);
  const double shift = d[end] - last * (last / (half + (half > 0 ? root : -root)));
  double x = d[begin] - shift, z = e[begin];
  for (int k = begin; k < end && z != 0; ++k) {
    const auto [c, s] = rotation(x, z);
    const double sdk = s * d[k] + c * e[k], next = s * e[k] + c * d[k + 1];
    d[k] = c * (c * d[k] - s * e[k]) - s * (c * e[k] - s * d[k + 1]);
    d[k + 1] = s * sdk + c * next;
    e[k] = c * sdk - s * next;
    if (k > begin) e[k - 1] = c * e[k - 1] - s * z;
    x = e[k];
    if (k + 1 < end) {
      z = -s * e[k + 1];
      e[k + 1] *= c;
    }
    if (q == nullptr) continue;
    double *left = q + t.size * k, *right = left + t.size;
    for (int i = 0; i < t.size; ++i) {
      const double l = left[i], r = right[i];
      left[i] = c * l - s * r;
      right[i] = s * l + c * r;
    }
  }
}

void diagonalise(Tridiagonal& t, double* q) {
  constexpr double kEpsilon = std::numeric_limits<double>::epsilon();
  for (int end = t.size - 1, steps = 0; end > 0 && steps < kMostSteps * t.size; ++steps) {
    for (int i = 0; i < end; ++i)
      if (std::fabs(t.below[i]) <=
          kEpsilon * std::sqrt(std::fabs(t.diagonal[i]) + std::fabs(t.diagonal[i + 1])))
        t.below[i] = 0;
    while (end > 0 && t.below[end - 1] == 0) --end;
    if (end == 0) break;
    int begin = end - 1;
    while (begin > 0 && t.below[begin - 1] != 0) --begin;
    step(t, begin, end, q);
  }
}

}  // namespace

SymmetricEigen symmetric_eigen(SmallMatrix a, bool vectors) {
  const int n = static_cast<int>(a.rows());
  // Of order one, so that squares neither vanish nor overflow.
  double scale = 0;
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i) scale = std::max(scale, std::fabs(a(i, j)));
  if (!(scale > 0)) scale = 1;
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i) a(i, j) /= scale;
  Tridiagonal t = tridiagonalise(a, vectors);
  diagonalise(t, vectors ? a.data() : nullptr);
  SymmetricEigen out{SmallVector(n), vectors ? a : SmallMatrix()};
  for (int k = 0; k < n; ++k) {
    const int least = static_cast<int>(std::min_element(t.diagonal + k, t.diagonal + n) - t.diagonal);
    std::swap(t.diagonal[k], t.diagonal[least]);
    if (vectors && least != k)
      std::swap_ranges(&out.vectors(0, k), &out.vectors(0, k) + n, &out.vectors(0, least));
    out.values[k] = scale * t.diagonal[k];
  }
  return out;
}

}  // namespace sonocal
