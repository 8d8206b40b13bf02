// Polynomials of one unknown in lanes, and their real roots by Sturm's theorem and guarded Halley steps.
#pragma once

#include "sonocal/solvers/lanes/lanes.hpp"

namespace sonocal {

// By rising powers.
template <class T, int N>
struct Polynomial {
  T c[N + 1];
};

template <class T, int A, int B>
SONOCAL_INLINE Polynomial<T, A + B> operator*(const Polynomial<T, A>& a, const Polynomial<T, B>& b) {
  Polynomial<T, A + B> out;
  for (int k = 0; k <= A + B; ++k) {
    const int first = k > B ? k - B : 0, last = k < A ? k : A;
    out.c[k] = a.c[first] * b.c[k - first];
    for (int i = first + 1; i <= last; ++i) out.c[k] += a.c[i] * b.c[k - i];
  }
  return out;
}
template <class T, int A, int B>
SONOCAL_INLINE Polynomial<T, (A > B ? A : B)> operator+(const Polynomial<T, A>& a,
                                                        const Polynomial<T, B>& b) {
  Polynomial<T, (A > B ? A : B)> out;
  for (int k = 0; k <= (A > B ? A : B); ++k) out.c[k] = k > A ? b.c[k] : k > B ? a.c[k] : a.c[k] + b.c[k];
  return out;
}
template <class T, int N>
SONOCAL_INLINE Polynomial<T, N> operator-(const Polynomial<T, N>& a) {
  Polynomial<T, N> out;
  for (int k = 0; k <= N; ++k) out.c[k] = -a.c[k];
  return out;
}
template <class T, int A, int B>
SONOCAL_INLINE Polynomial<T, (A > B ? A : B)> operator-(const Polynomial<T, A>& a,
                                                        const Polynomial<T, B>& b) {
  return a + -b;
}
template <class T, int N>
SONOCAL_INLINE T evaluate(const Polynomial<T, N>& p, const T& x) {
  T value = p.c[N];
  for (int i = N; i-- > 0;) value = value * x + p.c[i];
  return value;
}
template <class T, int N>
SONOCAL_INLINE Polynomial<T, N - 1> derivative(const Polynomial<T, N>& p) {
  Polynomial<T, N - 1> out;
  for (int i = 1; i <= N; ++i) out.c[i - 1] = static_cast<double>(i) * p.c[i];
  return out;
}

// The Sturm chain of a polynomial of degree N, each member scaled to leading coefficient +-1:
//     p_0 = p, p_1 = p', p_{k+1} = -(p_{k-1} mod p_k)
// In some lanes it ends early, at the common divisor.
template <int N>
struct SturmChain {
  Pack member[N + 1][N + 1];
  std::int64_t length[kWidth];  // 0 where the lane's polynomial is of a lower degree, or not finite
};

template <int N>
SONOCAL_INLINE void sturm_chain(const Polynomial<Pack, N>& p, const PackMask& valid, SturmChain<N>& out) {
  auto& m = out.member;
  Pack largest = broadcast<Pack>(0);
  for (int i = 0; i <= N; ++i) largest = larger<Pack>(abs(p.c[i]), largest);
  PackMask alive = valid & (abs(p.c[N]) > 1e-200 * largest) & finite(largest);
  const Pack lead = 1.0 / abs(p.c[N]);
  for (int i = 0; i <= N; ++i) m[0][i] = p.c[i] * lead;
  for (int i = 1; i <= N; ++i) m[1][i - 1] = (static_cast<double>(i) / N) * m[0][i];
  PackMask length = alive & 2;
  for (int k = 2; k <= N; ++k) {
    const Pack(&a)[N + 1] = m[k - 2], (&b)[N + 1] = m[k - 1];
    Pack(&to)[N + 1] = m[k];
    const int degree = N - k + 2;  // of a
    const Pack inverse = 1.0 / b[degree - 1];
    const Pack q1 = a[degree] * inverse, q0 = (a[degree - 1] - q1 * b[degree - 2]) * inverse;
    to[0] = q0 * b[0] - a[0];
    for (int i = 1; i <= degree - 2; ++i) to[i] = q0 * b[i] + q1 * b[i - 1] - a[i];
    const Pack scale = abs(to[degree - 2]), shrink = 1.0 / scale;
    for (int i = 0; i <= degree - 2; ++i) to[i] *= shrink;
    alive &= scale > 1e-300;
    length += alive & 1;
  }
  for (int i = 0; i < kWidth; ++i) out.length[i] = length[i];
}

// At how many places at once an interval is cut: enough to fill vectors, and mostly no second cut.
constexpr int kCuts = 32;
constexpr int kCutPacks = kCuts / kWidth;

// Places of u between low and high, and x = u / (1 - |u|), which leaves no root out of bounds.
struct Cuts {
  double u[kCuts], x[kCuts];
};
SONOCAL_INLINE constexpr Cuts cut(double low, double high) {
  Cuts out{};
  const double step = (high - low) / (kCuts + 1);
  for (int i = 0; i < kCuts; ++i) {
    const double u = low + step * (i + 1);
    out.u[i] = u;
    out.x[i] = u / (1.0 - (u < 0 ? -u : u));
  }
  return out;
}
constexpr Cuts kWhole = cut(-1, 1);

SONOCAL_INLINE Pack load(const double* from) {
  Pack out;
  std::memcpy(&out, from, sizeof out);
  return out;
}
SONOCAL_INLINE PackMask load(const std::int64_t* from) {
  PackMask out;
  std::memcpy(&out, from, sizeof out);
  return out;
}

// Of one lane's chain at the cuts: how often its sign changes, and -1 where the polynomial is negative.
struct Signs {
  std::int64_t changes[kCuts], negative[kCuts];
};
template <int N>
SONOCAL_INLINE void signs_at(const SturmChain<N>& chain, int lane, const Cuts& cuts, Signs& out) {
  Pack x[kCutPacks];
  for (int p = 0; p < kCutPacks; ++p) x[p] = load(cuts.x + p * kWidth);
  PackMask before[kCutPacks], changes[kCutPacks] = {}, first[kCutPacks];
  for (int k = 0; k < chain.length[lane]; ++k) {
    Pack value[kCutPacks];
    const int degree = N - k;
    for (int p = 0; p < kCutPacks; ++p) value[p] = broadcast<Pack>(chain.member[k][degree][lane]);
    for (int i = degree; i-- > 0;) {
      const double c = chain.member[k][i][lane];
      for (int p = 0; p < kCutPacks; ++p) value[p] = value[p] * x[p] + c;
    }
    for (int p = 0; p < kCutPacks; ++p) {
      const PackMask now = value[p] < 0.0;
      if (k == 0)
        first[p] = now;
      else
        changes[p] -= now ^ before[p];
      before[p] = now;
    }
  }
  std::memcpy(out.changes, changes, sizeof changes);
  std::memcpy(out.negative, first, sizeof first);
}
template <int N>
SONOCAL_INLINE std::int64_t changes_at_infinity(const SturmChain<N>& chain, int lane, bool minus) {
  std::int64_t count = 0;
  bool before = false;
  for (int k = 0; k < chain.length[lane]; ++k) {
    const bool now = (chain.member[k][N - k][lane] < 0) != (minus && (N - k) % 2 != 0);
    count += k > 0 && now != before;
    before = now;
  }
  return count;
}

// Where one root of a lane's polynomial lies alone: its signs at low and high differ. A multiple root, or
// two that rounding has merged, has low == high.
template <int N>
struct Brackets {
  static constexpr int kMost = N * kWidth;
  double low[kMost + kWidth], high[kMost + kWidth];  // and room to read whole packs
  std::int64_t lane[kMost + kWidth], negative_low[kMost + kWidth];
  int count = 0;

  SONOCAL_INLINE void add(double from, double to, int of, std::int64_t negative) {
    low[count] = from;
    high[count] = to;
    lane[count] = of;
    negative_low[count++] = negative;
  }
};

// Appends the lane's distinct real roots.
template <int N>
SONOCAL_INLINE void isolate(const SturmChain<N>& chain, int lane, Brackets<N>& out) {
  struct Interval {
    double low, high;
    std::int64_t at_low, at_high;
  };
  Interval stack[4 * N];
  int depth = 0;
  const int most = out.count + N;
  stack[depth++] = {-1, 1, changes_at_infinity(chain, lane, true), changes_at_infinity(chain, lane, false)};
  while (depth > 0 && out.count < most) {
    const Interval i = stack[--depth];
    if (i.at_low <= i.at_high) continue;
    if (i.high - i.low < 1e-9) {
      const double u = 0.5 * (i.low + i.high), x = u / (1.0 - (u < 0 ? -u : u));
      out.add(x, x, lane, 0);
      continue;
    }
    Cuts narrow;
    const bool first = i.high - i.low == 2;
    if (!first) narrow = cut(i.low, i.high);
    const Cuts& cuts = first ? kWhole : narrow;
    Signs at;
    signs_at(chain, lane, cuts, at);
    int part[kCuts + 1], parts = 0;
    for (int j = 0; j <= kCuts; ++j) {
      part[parts] = j;
      parts += (j == 0 ? i.at_low : at.changes[j - 1]) > (j == kCuts ? i.at_high : at.changes[j]);
    }
    for (int n = 0; n < parts; ++n) {
      const int j = part[n];
      const bool bounded = j > 0 && j < kCuts;
      if (bounded && at.changes[j - 1] - at.changes[j] == 1 && at.negative[j - 1] != at.negative[j]) {
        if (out.count < most) out.add(cuts.x[j - 1], cuts.x[j], lane, at.negative[j - 1]);
      } else if (depth < 4 * N) {
        stack[depth++] = {j == 0 ? i.low : cuts.u[j - 1], j == kCuts ? i.high : cuts.u[j],
                          j == 0 ? i.at_low : at.changes[j - 1], j == kCuts ? i.at_high : at.changes[j]};
      }
    }
  }
}

template <int N>
SONOCAL_APART void real_roots(const Polynomial<Pack, N>& p, const PackMask& valid, int lanes,
                              Brackets<N>& out) {
  SturmChain<N> chain;
  sturm_chain(p, valid, chain);
  for (int lane = 0; lane < lanes; ++lane)
    if (chain.length[lane] > 0) isolate(chain, lane, out);
}

// The roots in the brackets of a pack, one a lane, each of its own polynomial: Halley, bisecting where it
// strays; ends after a step of `tolerance` relative to the root.
template <int N>
SONOCAL_APART Pack root_in(const Polynomial<Pack, N>& p, Pack low, Pack high, const PackMask& negative_low,
                           double tolerance) {
  Pack x = 0.5 * (low + high);
  PackMask going = low < high;
  for (int iteration = 0; iteration < 60 && any(going); ++iteration) {
    Pack f = p.c[N], slope = broadcast<Pack>(0), bend = slope;
    for (int i = N; i-- > 0;) {
      bend = bend * x + slope;
      slope = slope * x + f;
      f = f * x + p.c[i];
    }
    const PackMask as_low = ~((f < 0.0) ^ negative_low);
    low = select(as_low, x, low);
    high = select(as_low, high, x);
    const Pack halley = x - f * slope / (slope * slope - f * bend);
    const Pack next = select((halley > low) & (halley < high), halley, 0.5 * (low + high));
    const Pack moved = abs(next - x);
    x = select(going, next, x);
    going &= moved > tolerance * abs(next);
  }
  return x;
}

}  // namespace sonocal
