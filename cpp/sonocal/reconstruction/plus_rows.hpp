// Which pixels of a row PLUS inserts: in the volume, in the clip rectangle and in the fan.
#pragma once

#include "sonocal/reconstruction/plus_slice.hpp"

namespace sonocal::plus {

// Pixels from <= u <= to, without those between `skip_from` and `skip_to` where something is skipped.
struct Run {
  int from, to;
  bool skips;
  int skip_from, skip_to;
};

struct Rectangle {
  int low[2], high[2];  // inclusive
};

Rectangle clip_rectangle(const Settings& settings, int width, int height);

class Fan {
 public:
  explicit Fan(const Settings& settings);
  bool on() const { return left_ != 0 || right_ != 0; }
  bool holds(int u, int v) const;
  // Narrows a run of row v, as the optimised code does: by a px on each side.
  void narrow(int v, Run& run) const;

 private:
  double left_, right_;  // tangents
  double origin_[2], start2_, stop2_;
};

// The run of row v: of the fan's, what is in the rectangle.
Run run_of(int v, int from, int to, const Fan& fan, const Rectangle& clip);

}  // namespace sonocal::plus
