#include "sonocal/detection/echo_fit.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/ldlt.hpp"

namespace sonocal {
namespace {

constexpr double kWhite = 250;    // grey level from which a pixel counts as saturated
constexpr double kBeyond = 0.15;  // of the pulse's half height: how far below the middle pixels still count
constexpr double kLeastHeight =
    6;  // px, from the middle to where nothing is left: flatter echoes stand apart
constexpr int kLeastPixels = 12;
constexpr int kRounds = 2;
// What a tail does to the middle of an echo that it has run into, from simulated needles. Mostly it adds to
// the echo and pulls its middle down: the more the taller the echo, at the most by what a tail can. Where it
// opposes the echo it pushes the middle up. Lengths in units of the image's finest scale: what they mean does
// not hang on how large the image is drawn.
constexpr double kMerged = 7.8;  // half height at a fixed u from which the two have run together
constexpr double kPull = 0.22;   // of what the half height is above it
constexpr double kGreatestPull = 1.2;
constexpr double kPush = 0.9;
constexpr double kAmbiguous = 1.2;  // between the two readings, from which both are given

struct Paraboloid {
  bool found = false;
  Eigen::Vector2d top;
  Eigen::Matrix2d curvature, shape;  // the one is the other's inverse
};

template <class Keep>
Paraboloid fit(const std::vector<EchoPixel>& pixels, Keep keep) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  Vector6 right = Vector6::Zero();
  int count = 0;
  for (const EchoPixel& p : pixels) {
    if (p.value >= kWhite || !keep(p)) continue;
    const Vector6 row = (Vector6() << 1, p.u, p.v, p.u * p.u, p.u * p.v, p.v * p.v).finished();
    for (int c = 0; c < 6; ++c) normal.col(c) += row[c] * row;
    right += p.value * row;
    ++count;
  }
  Paraboloid out;
  if (count < kLeastPixels) return out;
  const Vector6 c = Ldlt<6>(normal).solve(right);
  out.curvature << -c[3], -0.5 * c[4], -0.5 * c[4], -c[5];
  const Eigen::Matrix2d& k = out.curvature;
  const double det = k(0, 0) * k(1, 1) - k(0, 1) * k(1, 0);
  out.found = k(0, 0) + k(1, 1) > 0 && det > 1e-9;
  if (!out.found) return out;
  out.shape << k(1, 1) / det, -k(0, 1) / det, -k(1, 0) / det, k(0, 0) / det;
  out.top << 0.5 * (out.shape(0, 0) * c[1] + out.shape(0, 1) * c[2]),
      0.5 * (out.shape(1, 0) * c[1] + out.shape(1, 1) * c[2]);
  return out;
}

}  // namespace

EchoFit fit_echo(const std::vector<EchoPixel>& pixels, double contrast, double unit) {
  Paraboloid echo = fit(pixels, [](const EchoPixel&) { return true; });
  for (int round = 0; round < kRounds && echo.found; ++round) {
    if (contrast * echo.shape(1, 1) < kLeastHeight * kLeastHeight) break;
    const Eigen::Vector2d down = echo.curvature.col(1);
    const double least = kBeyond * std::sqrt(contrast * echo.curvature(1, 1));
    const Paraboloid upper = fit(
        pixels, [&](const EchoPixel& p) { return down.dot(Eigen::Vector2d(p.u, p.v) - echo.top) <= least; });
    if (!upper.found) break;
    echo = upper;
  }
  EchoFit out;
  out.found = echo.found;
  if (!out.found) return out;
  const double half_height = std::sqrt(contrast / echo.curvature(1, 1)) / unit;
  const double pull = std::clamp(kPull * (half_height - kMerged), 0.0, kGreatestPull);
  out.u = echo.top[0], out.v = echo.top[1] - unit * pull;
  if (pull + kPush >= kAmbiguous) out.deeper = unit * (pull + kPush);
  out.uu = echo.shape(0, 0), out.uv = echo.shape(0, 1), out.vv = echo.shape(1, 1);
  return out;
}

}  // namespace sonocal
