#include <algorithm>
#include <cmath>
#include <limits>

#include "sonocal/linalg/reflection.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

constexpr int kMostTurns = 40;  // for each value
constexpr double kUnit = std::numeric_limits<double>::epsilon();
constexpr double kTiny = 1e-150;  // whose square is a number still
// std::complex asks at each product whether a result is no number.
struct Complex {
  double re = 0, im = 0;
};
Complex operator+(Complex a, Complex b) { return {a.re + b.re, a.im + b.im}; }
Complex operator-(Complex a, Complex b) { return {a.re - b.re, a.im - b.im}; }
Complex operator*(Complex a, Complex b) { return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re}; }
Complex operator*(double s, Complex a) { return {s * a.re, s * a.im}; }
Complex conj(Complex a) { return {a.re, -a.im}; }
double length2(Complex a) { return a.re * a.re + a.im * a.im; }
double magnitude(Complex a) { return std::abs(a.re) + std::abs(a.im); }
Complex operator/(Complex a, Complex b) { return 1 / length2(b) * (a * conj(b)); }
Complex root(Complex a) {
  const double length = std::sqrt(std::sqrt(length2(a))), angle = 0.5 * std::atan2(a.im, a.re);
  return {length * std::cos(angle), length * std::sin(angle)};
}

struct ComplexMatrix {
  int n;
  Complex at[kMostSide][kMostSide];
};

// Zeros below the diagonal under the main one, by reflections from both sides; q becomes their product.
void to_hessenberg(SmallMatrix& a, SmallMatrix& q) {
  const int n = static_cast<int>(a.rows());
  q.setIdentity(n, n);
  for (int k = 0; k + 2 < n; ++k) {
    const int rest = n - k - 1;
    double v[kMostSide];
    std::copy_n(&a(k + 1, k), rest, v);
    const double tau = reflect(v, rest);
    a(k + 1, k) = v[0];
    std::fill_n(&a(k + 2, k), rest - 1, 0.0);
    v[0] = 1;
    for (int j = k + 1; j < n; ++j) apply_reflection(v, tau, &a(k + 1, j), rest);
    for (SmallMatrix* m : {&a, &q})
      for (int i = 0; i < n; ++i) {
        double along = 0;
        for (int j = 0; j < rest; ++j) along += (*m)(i, k + 1 + j) * v[j];
        for (int j = 0; j < rest; ++j) (*m)(i, k + 1 + j) -= tau * along * v[j];
      }
  }
}

// The value of the last two rows' block that is nearer to its last entry (Wilkinson).
Complex shift_of(const ComplexMatrix& h, int last) {
  const Complex a = h.at[last - 1][last - 1], d = h.at[last][last];
  const Complex bc = h.at[last - 1][last] * h.at[last][last - 1], half = 0.5 * (a - d);
  const Complex spread = root(half * half + bc);
  const Complex one = half + spread, other = half - spread;
  const Complex farther = length2(one) > length2(other) ? one : other;
  return length2(farther) == 0 ? d : d - bc / farther;
}

// One step of the QR iteration with a shift on the rows first to last of a Hessenberg matrix, by rotations.
void turn(ComplexMatrix& h, ComplexMatrix& q, int first, int last, Complex shift) {
  const int n = h.n;
  Complex c[kMostSide], s[kMostSide];
  for (int i = first; i <= last; ++i) h.at[i][i] = h.at[i][i] - shift;
  for (int k = first; k < last; ++k) {
    const Complex x = h.at[k][k], y = h.at[k + 1][k];
    const double length = std::sqrt(length2(x) + length2(y));
    c[k] = length > 0 ? 1 / length * x : Complex{1, 0};
    s[k] = length > 0 ? 1 / length * y : Complex{0, 0};
    for (int j = k; j < n; ++j) {
      const Complex upper = h.at[k][j], lower = h.at[k + 1][j];
      h.at[k][j] = conj(c[k]) * upper + conj(s[k]) * lower;
      h.at[k + 1][j] = c[k] * lower - s[k] * upper;
    }
  }
  for (int k = first; k < last; ++k) {
    for (ComplexMatrix* m : {&h, &q})
      for (int i = 0, rows = m == &h ? std::min(k + 2, last + 1) : n; i < rows; ++i) {
        const Complex left = m->at[i][k], right = m->at[i][k + 1];
        m->at[i][k] = left * c[k] + right * s[k];
        m->at[i][k + 1] = right * conj(c[k]) - left * conj(s[k]);
      }
  }
  for (int i = first; i <= last; ++i) h.at[i][i] = h.at[i][i] + shift;
}

// A Hessenberg matrix to a triangular one; false where that comes to no end.
bool to_triangle(ComplexMatrix& h, ComplexMatrix& q) {
  int steps = 0;
  for (int last = h.n - 1; last > 0;) {
    int first = last;
    for (; first > 0; --first) {
      const double beside = magnitude(h.at[first][first]) + magnitude(h.at[first - 1][first - 1]);
      if (magnitude(h.at[first][first - 1]) > kUnit * beside) continue;
      h.at[first][first - 1] = {};
      break;
    }
    if (first == last) {
      --last;
      steps = 0;
    } else if (++steps > kMostTurns) {
      return false;
    } else {
      // Now and then another shift, for matrices that the usual one turns in a circle.
      const bool stuck = steps % 11 == 10;
      turn(h, q, first, last, stuck ? Complex{magnitude(h.at[last][last - 1]), 0} : shift_of(h, last));
    }
  }
  return true;
}

// The vector of a value on the diagonal of a triangular matrix, in the coordinates before q.
void vector_of(const ComplexMatrix& t, const ComplexMatrix& q, int k, double least, Complex* out) {
  Complex v[kMostSide];
  v[k] = {1, 0};
  for (int i = k - 1; i >= 0; --i) {
    Complex sum;
    for (int j = i + 1; j <= k; ++j) sum = sum + t.at[i][j] * v[j];
    Complex apart = t.at[k][k] - t.at[i][i];
    if (magnitude(apart) < least) apart = {least, 0};
    v[i] = sum / apart;
  }
  for (int i = 0; i < t.n; ++i) {
    out[i] = {};
    for (int j = 0; j <= k; ++j) out[i] = out[i] + q.at[i][j] * v[j];
  }
}

// Whether another value is the conjugate of one: a real value that rounding parted from the real axis has
// none.
bool has_partner(const ComplexMatrix& t, int k) {
  const Complex value = t.at[k][k], mirrored = conj(value);
  for (int j = 0; j < t.n; ++j)
    if (j != k && t.at[j][j].im * value.im < 0 && magnitude(t.at[j][j] - mirrored) < std::abs(value.im))
      return true;
  return false;
}

}  // namespace

GeneralEigen general_eigen(const SmallMatrix& a) {
  const int n = static_cast<int>(a.rows());
  SmallMatrix hessenberg = a, turned;
  const double least = std::max(kUnit * hessenberg.cwiseAbs().maxCoeff(), kTiny);
  to_hessenberg(hessenberg, turned);
  ComplexMatrix t{n, {}}, q{n, {}};
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      t.at[i][j] = {hessenberg(i, j), 0};
      q.at[i][j] = {turned(i, j), 0};
    }
  GeneralEigen out;
  if (!to_triangle(t, q)) return out;
  out.found = true;
  for (int k = 0; k < n; ++k) {
    Complex value = t.at[k][k];
    const bool real = !has_partner(t, k);
    if (!real && value.im < 0) continue;  // its partner stands for both
    if (real) value.im = 0;
    Complex v[kMostSide];
    vector_of(t, q, k, least, v);
    // A real value's vector is real but for a common factor.
    int strongest = 0;
    for (int i = 0; i < n; ++i) {
      if (length2(v[i]) > length2(v[strongest])) strongest = i;
    }
    EigenPair& pair = out.pairs[out.count++];
    pair.value = {value.re, value.im};
    pair.real.resize(n);
    pair.imaginary.resize(n);
    const Complex whole = v[strongest];
    for (int i = 0; i < n; ++i) {
      const Complex part = v[i] / whole;
      pair.real[i] = part.re;
      pair.imaginary[i] = real ? 0 : part.im;
    }
  }
  return out;
}

}  // namespace sonocal
