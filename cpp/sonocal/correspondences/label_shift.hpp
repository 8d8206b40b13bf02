// The error that all dots of a frame share, as of its pose: a shift, small as such errors are.
#pragma once

#include <vector>

#include "sonocal/correspondences/label_scene.hpp"

namespace sonocal {

// Standard deviations along each axis: of a dot, and of the shift that a frame's dots share.
struct FrameErrors {
  double dot = 1, shift = 1;
};

// What a dot costs that no wire explains, in nats: as much as one that is three standard deviations off.
constexpr double kMostCost = 4.5;

struct ShiftedFrame {
  Vector3d shift = Vector3d::Zero();
  double cost = 0;  // sum over the dots of min(d^2 / (2 dot^2), kMostCost), and |shift|^2 / (2 shift^2)
  std::vector<DotOnWire> pairs;  // squares of what the shift leaves
};

// Shift, choose, shift again, from the pairs within reach on; the round that costs least.
ShiftedFrame shift_frame(const LabelScene& scene, const Transform& a, int frame, double reach,
                         const FrameErrors& errors);

}  // namespace sonocal
