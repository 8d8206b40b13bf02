// Where the wires of a frame cross its image, and the dots that are nearest to there.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "sonocal/correspondences/label_scene.hpp"

namespace sonocal {

// Of some frames: a grid over the image that knows each cell's nearest dot, and the wires side by side.
class LabelGrid {
 public:
  LabelGrid(const LabelScene& scene, std::vector<int> frames);

  int count() const { return static_cast<int>(frames_.size()); }
  int frame(int k) const { return frames_[k]; }
  // sum of 1 - d^2 / reach^2 over the dots that a wire crosses the image near to, one wire a dot.
  double quality(const Transform& a, int k, double reach) const;
  // The same pairs, appended.
  void pairs(const Transform& a, int k, double reach, std::vector<DotOnWire>& out) const;

 private:
  static constexpr int kCells = 64;
  // Each dot's nearest wire and the square of its distance.
  struct Nearest {
    std::array<float, kMostDots> square;
    std::array<std::int16_t, kMostDots> wire;
  };
  void match(const Transform& a, int k, float limit, Nearest& out) const;

  const LabelScene& scene_;
  std::vector<int> frames_;
  int stride_;
  std::vector<float> wires_;         // frames x (foot, direction) x stride
  std::vector<std::int16_t> cells_;  // frames x kCells x kCells
  float low_u_, low_v_, per_u_, per_v_;
};

}  // namespace sonocal
