// From a rough similarity to the labels that it gives and the least squares that these give, in turn.
#pragma once

#include <vector>

#include "sonocal/correspondences/label_scene.hpp"

namespace sonocal {

// Damped least squares of dots on their wires, from `a` on.
void fit_pairs(const LabelScene& scene, const std::vector<DotOnWire>& pairs, int steps, Transform& a);

// Of a frame, the pairs within reach, nearest first, one wire a dot and one dot a wire; appended.
void pairs_within(const LabelScene& scene, const Transform& a, int frame, double reach,
                  std::vector<DotOnWire>& out);

struct SettledLabels {
  Transform a;
  std::vector<DotOnWire> pairs;
  double score = 0;  // sum of 1 - d^2 / reach^2 over the pairs
};

// Choose, fit, choose again: within twice the reach, then within it, until nothing changes.
SettledLabels settle_labels(const LabelScene& scene, const std::vector<int>& frames, const Transform& start,
                            double reach);

}  // namespace sonocal
