#include "sonocal/estimate/apparent.hpp"

#include <algorithm>
#include <cmath>

namespace sonocal {
namespace {

constexpr double kDeviations = 3;
// The logarithm of a ratio of squared levels that leaves the lesser of them nothing that matters.
constexpr double kMostDoubt = 20;
// Powers of a matrix up to the 2^5-th: its greatest value within 6 % whatever the others are.
constexpr int kSquarings = 5;

// Of a matrix x whose values are real and not negative: (I - x)^-1 = (I + x) (I + x^2) (I + x^4) ... for
// values below one, and the greatest value, or a little more.
struct Powers {
  TangentMatrix series;
  double greatest;
};
Powers powers_of(TangentMatrix x) {
  const TangentMatrix one = TangentMatrix::Identity(x.rows(), x.cols());
  Powers out{one + x, 0};
  for (int i = 0; i < kSquarings; ++i) {
    x = times(x, x);
    out.series = times(out.series, one + x);
  }
  out.greatest = std::pow(std::max(x.trace(), 0.0), 1.0 / (1 << kSquarings));
  return out;
}

}  // namespace

Apparent apparent_of(const WhiteResiduals& white, double px_share, double ratio_variance,
                     const TangentMatrix& covariance) {
  const double freedom = std::max<double>(1, white.residual.size() - covariance.rows());
  // Levels that are given may be less than the noise is.
  const double unit = std::max(1.0, white.residual.squaredNorm() / freedom);
  const TangentMatrix of_px = unit * times(covariance, white.from_noise[0]);
  const TangentMatrix of_mm = unit * times(covariance, white.from_noise[1]);
  const Powers both = powers_of(of_px + of_mm);
  const double doubt = std::sqrt(std::max(ratio_variance, 0.0));
  Apparent out;
  // At a share of one the series has no sum, and nobody is told an error.
  out.widening =
      both.greatest < 1 ? both.series : TangentMatrix::Identity(covariance.rows(), covariance.cols());
  out.moved = doubt * out.widening.lazyProduct(covariance.lazyProduct(white.by_ratio).eval());
  out.share = both.greatest;
  // The ratio is another by so much, the variance of both together the same.
  const double most = std::exp(std::min(kDeviations * doubt, kMostDoubt));
  for (const double by : {1 / most, most}) {
    if (by == 1) continue;
    const double px = 1 / (px_share + (1 - px_share) / by), mm = 1 / (px_share * by + 1 - px_share);
    out.share = std::max(out.share, powers_of(px * of_px + mm * of_mm).greatest);
  }
  out.share *= 1 + kDeviations * std::sqrt(2 / std::max(1.0, 0.5 * freedom));
  return out;
}

}  // namespace sonocal
