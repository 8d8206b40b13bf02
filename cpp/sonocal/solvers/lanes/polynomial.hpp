// Real roots of cubics and quartics, closed form then Newton, in every lane.
#pragma once

#include "sonocal/solvers/lanes/lanes.hpp"

namespace sonocal {

// cos(acos(t) / 3) for -1 <= t <= 1: the largest y with 4 y^3 - 3 y = t. A polynomial in
// sqrt((1 + t) / 2), exact at t = -1 where the root is double, then Newton.
template <class T>
SONOCAL_INLINE T cosine_of_third(const T& t) {
  const T u = sqrt(0.5 * (1.0 + t));
  T y = 0.5 + u * (0.57725766 + u * (-0.10911232 + u * (0.04308233 - u * 0.01129553)));
  for (int iteration = 0; iteration < 2; ++iteration) {
    const T slope = 12.0 * y * y - 3.0;
    y = select(slope > 0.0, y - (y * (4.0 * y * y - 3.0) - t) / slope, y);
  }
  return y;
}

// The largest real root of x^3 + b x^2 + c x + d, to 1e-8 of the largest: where to start Newton.
template <class T>
SONOCAL_INLINE T largest_cubic_root(const T& b, const T& c, const T& d) {
  const T shift = b * (1.0 / 3.0);
  const T third_p = (c - b * shift) * (1.0 / 3.0);
  const T half_q = 0.5 * (d - c * shift) + shift * shift * shift;
  const T discriminant = half_q * half_q + third_p * third_p * third_p;
  const Mask<T> one_real = discriminant > 0.0;
  T x{};
  if (any(one_real)) {
    const T u = cube_root<T>(abs(half_q) + sqrt<T>(select(one_real, discriminant, T{})));
    x = with_sign<T>(select(u > 0.0, third_p / u - u, T{}), half_q);
  }
  if (any(discriminant <= 0.0)) {
    const T one = broadcast<T>(1.0), radius = sqrt<T>(select(third_p < 0.0, -third_p, T{}));
    const T ratio = select(radius > 0.0, -half_q / (radius * radius * radius), T{});
    const T largest =
        2.0 * radius * cosine_of_third<T>(select(abs(ratio) < 1.0, ratio, with_sign(one, ratio)));
    x = select(one_real, x, largest);
  }
  return x - shift;
}

template <class T>
struct QuarticRoots {
  T value[4];
  Mask<T> real[2];  // of each pair, values 0 and 1, 2 and 3
  // Where a pair is complex: its real part stands in the pair's first place.
  Mask<T> part[2];
};

// Roots of a[4] x^4 + ... + a[0] by Ferrari's method, each polished by Newton on the polynomial.
template <class T>
SONOCAL_INLINE QuarticRoots<T> quartic_roots(const T (&a)[5]) {
  // The reversed polynomial has the reciprocal roots: divide by the larger end.
  const Mask<T> reversed = abs(a[4]) < abs(a[0]);
  const T lead = 1.0 / select(reversed, a[0], a[4]);
  const T b3 = select(reversed, a[1], a[3]) * lead, b2 = a[2] * lead;
  const T b1 = select(reversed, a[3], a[1]) * lead, b0 = select(reversed, a[4], a[0]) * lead;

  // Depressed quartic z^4 + p z^2 + q z + r at x = z - b3/4.
  const T h = 0.25 * b3, h2 = h * h;
  const T p = b2 - 6.0 * h2;
  const T q = b1 - 2.0 * b2 * h + 8.0 * h * h2;
  const T r = b0 - b1 * h + b2 * h2 - 3.0 * h2 * h2;

  // z^4 + p z^2 + q z + r = (z^2 + k z + m)(z^2 - k z + n), k^2 the largest root of the resolvent.
  const T k2 = larger(largest_cubic_root<T>(2.0 * p, p * p - 4.0 * r, -q * q), T{});
  const T k = sqrt(k2), sum = p + k2;
  const T difference = select(k > 0.0, q / k, sqrt(larger(sum * sum - 4.0 * r, T{})));

  QuarticRoots<T> roots;
  for (int pair = 0; pair < 2; ++pair) {
    const T half = pair == 0 ? -0.5 * k : 0.5 * k;
    const T constant = 0.5 * (pair == 0 ? sum - difference : sum + difference);
    const T discriminant = half * half - constant;
    const Mask<T> real = discriminant >= 0.0;
    const T far = half + with_sign(sqrt(select(real, discriminant, T{})), half);
    const T near = select(far != 0.0, constant / far, T{});
    roots.value[2 * pair] = select(real, far, half) - h;
    roots.value[2 * pair + 1] = near - h;
    roots.real[pair] = real;
    roots.part[pair] = discriminant < 0.0;
  }
  for (int i = 0; i < 4; ++i) {
    if (!any(roots.real[i / 2] | roots.part[i / 2])) continue;
    T& x = roots.value[i];
    for (int iteration = 0; iteration < 2 && any(roots.real[i / 2]); ++iteration) {
      const T f = (((x + b3) * x + b2) * x + b1) * x + b0;
      const T slope = ((4.0 * x + 3.0 * b3) * x + 2.0 * b2) * x + b1;
      const T step = f / slope;
      x = select(roots.real[i / 2] & finite(step), x - step, x);
    }
    x = select(reversed, 1.0 / x, x);
  }
  return roots;
}

}  // namespace sonocal
