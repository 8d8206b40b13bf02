// Whether an answer of least squares is the best of all, and not only of its neighbourhood.
#pragma once

#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/estimate/mixed_table.hpp"
#include "sonocal/estimate/table.hpp"
#include "sonocal/solvers/normal_equations.hpp"

namespace sonocal {

enum class Certificate {
  kNotShown,  // another answer may be better
  kTied,      // none is better, but another may be as good
  kOptimal,   // every other one is worse
};

// Of the rows with chosen[i], whose weights are taken as they are at the transform. Of its neighbourhood it
// must be the best; one that is not has kNotShown.
Certificate certificate(const Table& table, const bool* chosen, const Transform& at, const Options& options);

// Of the correspondences with chosen[c]; `fixed_scale` > 0: the scale is known, and the transform has it.
Certificate certificate(const Correspondences& all, const bool* chosen, const double* weights,
                        double fixed_scale, const Transform& at);

// Of the sightings with chosen[c], weighed as they are at the transform by the levels.
Certificate certificate(const MixedTable& table, const bool* chosen, const Transform& at,
                        const Options& options);

// Of a quadratic cost at a transform; where it has a slope, kNotShown.
Certificate certificate(const NormalEquations& equations, const Transform& at, Model model);

}  // namespace sonocal
