// Which dot is of which wire: hypotheses of four pairs, solved, scored and settled, until one is found again.
#pragma once

#include <cstdint>
#include <vector>

#include "sonocal/correspondences/label_scene.hpp"

namespace sonocal {

struct LabelSearchOptions {
  double reach = 1;       // mm: farther from its wire a dot is not of it
  int finds = 5;          // the best answer must be found so often
  std::int64_t most = 0;  // hypotheses
  double most_seconds = 0;
  double least_scale = 0, largest_scale = 0;  // mm per px
  std::uint64_t seed = 0;
};

// An answer, settled on up to sixteen frames.
struct LabelCandidate {
  Transform a;       // as the table is
  double score = 0;  // of these frames, in dots: how many are explained, but for what a frame's share
  int finds = 0;
  std::vector<DotOnWire> pairs;  // by dot
};

struct LabelSearch {
  std::vector<LabelCandidate> candidates;  // the best first
  std::int64_t hypotheses = 0;
  bool finished = false;
};

// Half of the hypotheses are four dots of one frame on four wires, half two of each of two frames: three
// wires, or few dots a frame, have no others. Each similarity that four pairs give (paper section 6.2; the
// real parts of complex pairs, too) is scored where the wires cross its own frames; the best part is refined
// there and scored on up to sixteen frames; the best part of these is settled.
LabelSearch search_labels(const LabelScene& scene, const LabelSearchOptions& options);

}  // namespace sonocal
