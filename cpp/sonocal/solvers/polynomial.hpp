// Real roots of low-degree polynomials, closed form then Newton.
#pragma once

#include <array>
#include <cmath>
#include <utility>

namespace sonocal {

struct Roots {
  std::array<double, 4> value;
  int count = 0;
  // How many of them, first, are real; the others are real parts of complex pairs.
  int real_count = 0;
};

// The largest real root of x^3 + b x^2 + c x + d.
inline double largest_cubic_root(double b, double c, double d) {
  const double shift = b / 3.0;
  const double p = c - b * shift;
  const double q = d - c * shift + 2.0 * shift * shift * shift;
  const double half_q = 0.5 * q;
  const double third_p = p / 3.0;
  const double discriminant = half_q * half_q + third_p * third_p * third_p;
  double x;
  if (discriminant > 0) {
    const double root = std::sqrt(discriminant);
    const double u = std::cbrt(half_q < 0 ? -half_q + root : -half_q - root);
    x = u - (u != 0 ? third_p / u : 0.0);
  } else {
    const double radius = std::sqrt(-third_p);
    const double ratio = radius > 0 ? -half_q / (radius * radius * radius) : 0.0;
    x = 2.0 * radius * std::cos(std::acos(std::fmin(1.0, std::fmax(-1.0, ratio))) / 3.0);
  }
  return x - shift;
}

// Roots of a[4] x^4 + ... + a[0] by Ferrari's method, each polished by Newton on the polynomial.
// With `real_parts`, each complex pair adds its real part after the real roots: where noise has
// pushed two roots off the real axis it is the best real guess.
inline Roots quartic_roots(const std::array<double, 5>& a, bool real_parts) {
  // The reversed polynomial has the reciprocal roots: divide by the larger end.
  const bool reversed = std::fabs(a[4]) < std::fabs(a[0]);
  const std::array<double, 5> c = reversed ? std::array<double, 5>{a[4], a[3], a[2], a[1], a[0]} : a;
  const double lead = 1.0 / c[4];
  const double b3 = c[3] * lead, b2 = c[2] * lead, b1 = c[1] * lead, b0 = c[0] * lead;

  // Depressed quartic z^4 + p z^2 + q z + r at x = z - b3/4.
  const double h = 0.25 * b3;
  const double p = b2 - 6.0 * h * h;
  const double q = b1 - 2.0 * b2 * h + 8.0 * h * h * h;
  const double r = b0 - b1 * h + b2 * h * h - 3.0 * h * h * h * h;

  // z^4 + p z^2 + q z + r = (z^2 + k z + m)(z^2 - k z + n), k^2 the largest root of the resolvent.
  const double k2 = std::fmax(0.0, largest_cubic_root(2.0 * p, p * p - 4.0 * r, -q * q));
  const double k = std::sqrt(k2);
  const double sum = p + k2;
  const double difference = k > 0 ? q / k : std::sqrt(std::fmax(0.0, sum * sum - 4.0 * r));
  const std::array<std::pair<double, double>, 2> factors{
      {{k, 0.5 * (sum - difference)}, {-k, 0.5 * (sum + difference)}}};

  Roots roots;
  std::array<double, 2> parts;
  int part_count = 0;
  for (const auto& [linear, constant] : factors) {
    const double discriminant = 0.25 * linear * linear - constant;
    if (discriminant >= 0) {
      const double far = -0.5 * linear - std::copysign(std::sqrt(discriminant), linear);
      roots.value[roots.count++] = far - h;
      roots.value[roots.count++] = (far != 0 ? constant / far : 0.0) - h;
    } else {
      parts[part_count++] = -0.5 * linear - h;
    }
  }
  for (int i = 0; i < roots.count; ++i) {
    double& x = roots.value[i];
    for (int iteration = 0; iteration < 2; ++iteration) {
      const double f = (((x + b3) * x + b2) * x + b1) * x + b0;
      const double slope = ((4.0 * x + 3.0 * b3) * x + 2.0 * b2) * x + b1;
      const double step = f / slope;
      if (std::isfinite(step)) x -= step;
    }
  }
  roots.real_count = roots.count;
  if (real_parts)
    for (int i = 0; i < part_count; ++i) roots.value[roots.count++] = parts[i];
  if (reversed)
    for (int i = 0; i < roots.count; ++i) roots.value[i] = 1.0 / roots.value[i];
  return roots;
}

}  // namespace sonocal
