// Real roots of a polynomial of any magnitude, by Sturm's theorem and guarded Newton.
#pragma once

#include <array>
#include <cmath>

namespace sonocal {

// Polynomials by rising powers.
template <int N>
using Polynomial = std::array<double, N + 1>;

template <std::size_t A, std::size_t B>
inline std::array<double, A + B - 1> multiply(const std::array<double, A>& a,
                                              const std::array<double, B>& b) {
  std::array<double, A + B - 1> out{};
  for (std::size_t i = 0; i < A; ++i)
    for (std::size_t j = 0; j < B; ++j) out[i + j] += a[i] * b[j];
  return out;
}

// a + factor * b, b no longer than a.
template <std::size_t A, std::size_t B>
inline std::array<double, A> plus(std::array<double, A> a, const std::array<double, B>& b,
                                  double factor = 1) {
  for (std::size_t i = 0; i < B; ++i) a[i] += factor * b[i];
  return a;
}

template <std::size_t A>
inline double evaluate(const std::array<double, A>& p, double x) {
  double value = p[A - 1];
  for (std::size_t i = A - 1; i-- > 0;) value = value * x + p[i];
  return value;
}

// The Sturm chain of a polynomial of degree N, each member scaled to leading coefficient +-1:
//     p_0 = p, p_1 = p', p_{k+1} = -(p_{k-1} mod p_k)
template <int N>
class SturmChain {
 public:
  explicit SturmChain(const Polynomial<N>& p) {
    for (int i = 0; i <= N; ++i) members_[0][i] = p[i];
    for (int i = 1; i <= N; ++i) members_[1][i - 1] = i * p[i] / (N * std::fabs(p[N]));
    for (int i = 0; i <= N; ++i) members_[0][i] /= std::fabs(p[N]);
    for (length_ = 2; length_ <= N; ++length_)
      if (!remainder(length_)) break;
  }

  // Changes of sign along the chain at x; at infinity of either sign by the leading coefficients.
  int changes(double x) const {
    // Members past the end are zero: they change nothing, and a fixed length keeps the loops unrolled.
    std::array<double, N + 1> value;
    for (int k = 0; k <= N; ++k) value[k] = members_[k][N - k];
    for (int i = N - 1; i >= 0; --i)
      for (int k = 0; k <= N; ++k)
        if (i < N - k) value[k] = value[k] * x + members_[k][i];
    int count = 0;
    bool negative = value[0] < 0;
    for (int k = 1; k < length_; ++k) {
      const bool now = value[k] < 0;
      count += now != negative;
      negative = now;
    }
    return count;
  }
  int changes_at_infinity(int side) const {
    int count = 0;
    bool negative = false;
    for (int k = 0; k < length_; ++k) {
      const bool now = (members_[k][N - k] < 0) != (side < 0 && (N - k) % 2 != 0);
      count += k > 0 && now != negative;
      negative = now;
    }
    return count;
  }

  // The root between low and high, where the polynomial has opposite signs: Newton, bisecting where it
  // strays.
  double polish(double low, double high, double tolerance) const {
    double at_low = value(low);
    double x = 0.5 * (low + high);
    for (int iteration = 0; iteration < 60; ++iteration) {
      double f = members_[0][N], slope = 0;
      for (int i = N; i-- > 0;) {
        slope = slope * x + f;
        f = f * x + members_[0][i];
      }
      if ((f < 0) == (at_low < 0))
        low = x;
      else
        high = x;
      double next = x - f / slope;
      if (!(next > low && next < high)) next = 0.5 * (low + high);
      const double moved = std::fabs(next - x);
      x = next;
      if (moved <= tolerance * std::fabs(x)) break;
    }
    return x;
  }
  double value(double x) const { return evaluate(members_[0], x); }

 private:
  // False where nothing is left: the chain ends at the common divisor.
  bool remainder(int k) {
    const auto &a = members_[k - 2], &b = members_[k - 1];
    const int degree = N - k + 2;  // of a
    const double lead = 1.0 / b[degree - 1];
    const double q1 = a[degree] * lead, q0 = (a[degree - 1] - q1 * b[degree - 2]) * lead;
    auto& out = members_[k];
    for (int i = 0; i <= degree - 2; ++i) out[i] = q0 * b[i] + (i > 0 ? q1 * b[i - 1] : 0.0) - a[i];
    const double scale = std::fabs(out[degree - 2]);
    if (!(scale > 1e-300)) return false;
    for (int i = 0; i <= degree - 2; ++i) out[i] /= scale;
    return true;
  }

  std::array<std::array<double, N + 1>, N + 1> members_{};
  int length_ = 0;
};

// Distinct real roots; Newton stops after a step of `tolerance` relative to the root. Without bounds:
// intervals of u are halved, x = u / (1 - |u|).
template <int N>
inline int real_roots(const Polynomial<N>& p, double tolerance, double* roots) {
  double largest = 0;
  for (const double c : p) largest = std::fmax(largest, std::fabs(c));
  if (!(std::fabs(p[N]) > 1e-200 * largest) || !std::isfinite(largest)) return 0;
  const SturmChain<N> chain(p);
  struct Interval {
    double low, high;
    int at_low, at_high;
  };
  std::array<Interval, 4 * N> stack;
  int depth = 0, count = 0;
  stack[depth++] = {-1, 1, chain.changes_at_infinity(-1), chain.changes_at_infinity(1)};
  const auto x_of = [](double u) { return u / (1.0 - std::fabs(u)); };
  while (depth > 0) {
    const Interval i = stack[--depth];
    const int inside = i.at_low - i.at_high;
    if (inside <= 0) continue;
    const bool bounded = i.low > -1 && i.high < 1;
    const double width = i.high - i.low;
    if (inside == 1 && bounded && width < 0.3) {
      const double low = x_of(i.low), high = x_of(i.high);
      if ((chain.value(low) < 0) != (chain.value(high) < 0)) {
        if (count < N) roots[count++] = chain.polish(low, high, tolerance);
        continue;
      }
    }
    const double middle = 0.5 * (i.low + i.high);
    if (width < 1e-9) {  // a multiple root, or two that rounding has merged
      if (count < N) roots[count++] = x_of(middle);
      continue;
    }
    if (depth + 2 > static_cast<int>(stack.size())) continue;
    const int at_middle = chain.changes(x_of(middle));
    stack[depth++] = {middle, i.high, at_middle, i.at_high};
    stack[depth++] = {i.low, middle, i.at_low, at_middle};
  }
  return count;
}

}  // namespace sonocal
