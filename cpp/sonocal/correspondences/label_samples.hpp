// Hypotheses of four dots on four wires.
#pragma once

#include <array>
#include <vector>

#include "sonocal/correspondences/label_scene.hpp"
#include "sonocal/robust/random.hpp"

namespace sonocal {

struct FourPairs {
  std::array<int, 2> frame;  // places in the list of frames; alike where all four are of one
  std::array<DotOnWire, 4> pair;
};

class LabelSamples {
 public:
  // `frames`: where to draw from.
  LabelSamples(const LabelScene& scene, const std::vector<int>& frames, std::uint64_t seed);

  bool none() const { return fours_.empty() && pairs_.empty(); }
  // False: the four dots are nearly on one line, and there is nothing to solve.
  bool draw(FourPairs& out);

 private:
  void draw_from(int place, int count, DotOnWire* out);
  bool spread(const FourPairs& sample) const;

  const LabelScene& scene_;
  const std::vector<int>& frames_;
  std::vector<int> fours_, pairs_;  // places of frames with four dots, with two
  Random random_;
  bool from_one_ = false;
};

}  // namespace sonocal
