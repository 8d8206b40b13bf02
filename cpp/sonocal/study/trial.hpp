// One trial of a study: a method's answer to one table, before and after refinement.
#pragma once

#include <cstdint>
#include <optional>

#include "sonocal/estimate/estimate.hpp"
#include "sonocal/study/hypotheses.hpp"

namespace sonocal {

struct Method {
  Solver solver = Solver::kClosedForm;
  // Geometric: RANSAC's winner refined on the rows that agree (paper sections 8 and 9). Likelihood:
  // estimate().
  Weighting weighting = Weighting::kGeometric;
};

struct TrialAnswer {
  std::optional<Transform> start;  // RANSAC's winner
  std::optional<Transform> refined;
};

TrialAnswer run_trial(const Table& table, const Method& method, const Options& options);

// The least covariance that any unbiased estimate can have (Cramer-Rao), of the tangent at the truth,
// original units: table holds the true points and segments, options the noise levels. The places of the
// points along their needles are unknown and eliminated. NaN where the rows leave a motion free.
Eigen::Matrix<double, 7, 7> cramer_rao_bound(const Table& table, const bool* sound, const Transform& truth,
                                             const Options& options);

}  // namespace sonocal
