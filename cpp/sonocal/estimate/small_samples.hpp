// Covariances whose weights were estimated from the same few residuals.
#pragma once

#include "sonocal/solvers/normal_equations.hpp"

namespace sonocal {

// M x k: derivatives of residuals that are independent and of unit variance.
using WhiteJacobian = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct WiderCovariance {
  TangentMatrix covariance;
  double
      freedom;  // of the F distribution that e' covariance^-1 e / k has; infinite where all levels are known
  double ratio_variance;  // of the logarithm of the levels' squares' ratio
};

// The covariance (J'J)^-1 of k parameters once the noise levels behind its weights are not taken for known:
// with V the residuals' covariance, linear in the levels' squares, its derivatives (columns of `by_level`, M
// x L, of the log variances by the squares' logarithms) give both a larger covariance and the freedom of the
// F distribution that fits the Mahalanobis distances' mean and variance. Source: Kenward and Roger 1997.
//
// Where both levels are estimated their prior (kRatioSpread) has a part in them: `log_ratio`, of the parts
// that they have in all variances' sum, is what it draws to 0, and by that their errors and the covariance
// follow.
WiderCovariance small_sample_covariance(const WhiteJacobian& jacobian, const Eigen::MatrixX2d& by_level,
                                        const TangentMatrix& covariance, double log_ratio);

}  // namespace sonocal
