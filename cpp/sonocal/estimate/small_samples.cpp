#include "sonocal/estimate/small_samples.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "sonocal/estimate/likelihood.hpp"
#include "sonocal/linalg/small.hpp"

namespace sonocal {
namespace {

// The greatest variance of a number between -1 and 1 (Popoviciu).
constexpr double kGreatestVariance = 1.0;
// Residuals to spare below this leave the approximation without meaning.
constexpr double kLeastFreedom = 4.5;
// Singular values below this part of the greatest are none.
constexpr double kCutOff = 1e-10;
constexpr int kLevels = 2;

double trace_of_product(const TangentMatrix& a, const TangentMatrix& b) {
  return a.cwiseProduct(b.transpose()).sum();
}

// Sums over the residuals' rows j: J' diag(level) J of each level, and of each two levels' product.
struct Sums {
  TangentMatrix pull[kLevels], cross[kLevels][kLevels];
  double inner[kLevels][kLevels];
};

// Lower triangles of k x k matrices, row after row.
constexpr int kMostEntries = kMostParameters * (kMostParameters + 1) / 2;
using Triangle = std::array<double, kMostEntries>;

TangentMatrix unfolded(const Triangle& sum, Eigen::Index k) {
  TangentMatrix out(k, k);
  for (Eigen::Index a = 0, t = 0; a < k; ++a)
    for (Eigen::Index b = 0; b <= a; ++b, ++t) out(a, b) = out(b, a) = sum[t];
  return out;
}

// All sums in one pass, for which a row's products are taken once.
Sums sums_of(const WhiteJacobian& jacobian, const Eigen::MatrixX2d& levels, int count) {
  const Eigen::Index k = jacobian.cols();
  const int entries = static_cast<int>(k * (k + 1) / 2), kinds = count == 2 ? 5 : 2;
  Triangle sum[5] = {}, products = {};
  double inner[3] = {};
  for (Eigen::Index m = 0; m < levels.rows(); ++m) {
    const double* j = jacobian.data() + m * k;
    for (Eigen::Index a = 0, t = 0; a < k; ++a)
      for (Eigen::Index b = 0; b <= a; ++b, ++t) products[t] = j[a] * j[b];
    const double x = levels(m, 0), y = count == 2 ? levels(m, 1) : 0.0;
    const double weight[5] = {x, x * x, y, y * y, x * y};
    for (int kind = 0; kind < kinds; ++kind)
      for (int t = 0; t < entries; ++t) sum[kind][t] += weight[kind] * products[t];
    inner[0] += x * x, inner[1] += y * y, inner[2] += x * y;
  }
  Sums out;
  for (int i = 0; i < count; ++i) {
    out.pull[i] = unfolded(sum[2 * i], k);
    out.cross[i][i] = unfolded(sum[2 * i + 1], k);
    out.inner[i][i] = inner[i];
  }
  if (count == 2) {
    out.cross[0][1] = out.cross[1][0] = unfolded(sum[4], k);
    out.inner[0][1] = out.inner[1][0] = inner[2];
  }
  return out;
}

SmallMatrix pseudo_inverse(const SmallMatrix& a) {
  const SymmetricEigen of = symmetric_eigen(a);
  const double least = kCutOff * of.values.cwiseAbs().maxCoeff();
  SmallMatrix out = SmallMatrix::Zero(a.rows(), a.cols());
  for (Eigen::Index i = 0; i < a.rows(); ++i) {
    if (!(std::abs(of.values[i]) > least)) continue;
    for (Eigen::Index r = 0; r < a.rows(); ++r)
      for (Eigen::Index c = 0; c < a.cols(); ++c)
        out(r, c) += of.vectors(r, i) * of.vectors(c, i) / of.values[i];
  }
  return out;
}

// A factor, and the freedom m, such that the factor times the Wald statistic is F of (size, m); `first` and
// `second` are the source's A1 and A2.
struct Scaled {
  double factor, freedom;
};
Scaled f_distribution(double size, double first, double second) {
  const double spread = (first + 6 * second) / (2 * size);
  const double g = ((size + 1) * first - (size + 4) * second) / ((size + 2) * second);
  const double below = 3 * size + 2 * (1 - g);
  const double c1 = g / below, c2 = (size - g) / below, c3 = (size + 2 - g) / below;
  const double mean = 1 / std::max(1 - second / size, 1e-3);
  const double variance =
      (2 / size) * (1 + c1 * spread) / (std::pow(1 - c2 * spread, 2) * std::max(1 - c3 * spread, 1e-3));
  const double ratio = variance / (2 * mean * mean);
  if (!(size * ratio > 1)) return {1 / mean, std::numeric_limits<double>::infinity()};
  const double freedom = std::max(4 + (size + 2) / (size * ratio - 1), kLeastFreedom);
  return {freedom / (mean * (freedom - 2)), freedom};
}

// What is known of the levels that were found, x_i their squares' logarithms in units of 1 / by_share.
struct LevelErrors {
  SmallMatrix square;         // the mean of the error's square
  SmallVector bias;           // of that the mean, which the prior makes
  double ratio_variance = 0;  // of the logarithm of their ratio
};

// The maximum of likelihood and prior is off by S (score + p), S = (I + P)^-1: the score has the variance I,
// and p is the prior's slope. Rows that weigh the two alike leave them where the prior has them.
LevelErrors errors_of(const SmallMatrix& information, const SmallVector& by_share, double log_ratio,
                      const double (&difference)[kLevels]) {
  constexpr double kPrecision = 1 / (kRatioSpread * kRatioSpread);
  SmallMatrix both = information, bounded = information;
  for (int i = 0; i < kLevels; ++i)
    for (int j = 0; j < kLevels; ++j) {
      both(i, j) += kPrecision * by_share[i] * by_share[j];
      // Neither level is negative and both together make up the variance: their difference is within +-1 of
      // it, however little the residuals say of it.
      bounded(i, j) += difference[i] * difference[j] / kGreatestVariance;
    }
  const SmallMatrix s = pseudo_inverse(both), ratio = pseudo_inverse(bounded);
  LevelErrors out{times(times(s, information), s), SmallVector::Zero(kLevels), 0};
  for (int i = 0; i < kLevels; ++i)
    for (int j = 0; j < kLevels; ++j) {
      out.bias[i] -= s(i, j) * kPrecision * log_ratio * by_share[j];
      out.ratio_variance += by_share[i] * ratio(i, j) * by_share[j];
    }
  for (int i = 0; i < kLevels; ++i)
    for (int j = 0; j < kLevels; ++j) out.square(i, j) += out.bias[i] * out.bias[j];
  return out;
}

}  // namespace

WiderCovariance small_sample_covariance(const WhiteJacobian& jacobian, const Eigen::MatrixX2d& by_level,
                                        const TangentMatrix& covariance, double log_ratio) {
  Eigen::MatrixX2d levels(by_level.rows(), kLevels);
  int count = 0;
  SmallVector by_share(kLevels);  // the logarithm of the levels' ratio, by each level's part of the variance
  for (int i = 0; i < kLevels; ++i)
    if (const double size = by_level.col(i).cwiseAbs().maxCoeff(); size > 0) {
      by_share[count] = (i == 0 ? 1 : -1) / size;
      levels.col(count++) = by_level.col(i) / size;
    }
  if (count == 0) return {covariance, std::numeric_limits<double>::infinity(), 0};
  const Sums sums = sums_of(jacobian, levels, count);
  TangentMatrix share[kLevels];
  SmallMatrix information(count, count);
  for (int i = 0; i < count; ++i) share[i] = times(sums.pull[i], covariance);
  for (int i = 0; i < count; ++i)
    for (int j = 0; j < count; ++j)
      information(i, j) = 0.5 * (sums.inner[i][j] - 2 * trace_of_product(covariance, sums.cross[i][j]) +
                                 trace_of_product(share[i], share[j]));
  LevelErrors errors;
  TangentMatrix wider = covariance;
  if (count == kLevels) {
    errors = errors_of(information, by_share, log_ratio, {levels.col(0).mean(), -levels.col(1).mean()});
    // What the prior made of the covariance, undone: C is a sum of what each level's noise makes of it.
    for (int i = 0; i < kLevels; ++i) {
      const double size = 1 / std::abs(by_share[i]), undone = std::expm1(-errors.bias[i] / size);
      wider += undone * size * times(covariance, share[i]);
    }
  } else {
    errors.square = pseudo_inverse(information);
    errors.ratio_variance = by_share[0] * by_share[0] * errors.square(0, 0);
  }
  double first = 0, second = 0;
  for (int i = 0; i < count; ++i)
    for (int j = 0; j < count; ++j) {
      const TangentMatrix hidden = sums.cross[i][j] - times(share[i], sums.pull[j]);
      wider += 2 * errors.square(i, j) * times(times(covariance, hidden), covariance);
      first += errors.square(i, j) * share[i].trace() * share[j].trace();
      second += errors.square(i, j) * trace_of_product(share[i], share[j]);
    }
  const TangentMatrix symmetric = 0.5 * (wider + wider.transpose());
  const Scaled scaled = f_distribution(static_cast<double>(covariance.rows()), first, second);
  return {symmetric / scaled.factor, scaled.freedom, errors.ratio_variance};
}

}  // namespace sonocal
