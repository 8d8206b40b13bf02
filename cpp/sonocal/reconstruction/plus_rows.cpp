#include "sonocal/reconstruction/plus_rows.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/reconstruction/plus_numbers.hpp"

namespace sonocal::plus {
namespace {

constexpr double kRadPerDegree = 0.017453292519943295;

int ceiling(double x) { return -floor_of(-x); }

void narrow_to(Run& run, double low, double high) {
  run.from = std::max(run.from, ceiling(low));
  run.to = std::min(run.to, floor_of(high));
}

// Where the skipped piece reaches over an end of the run, the run is shorter and nothing is skipped.
void settle_skip(Run& run) {
  if (!run.skips) return;
  if (run.skip_from < run.from) {
    if (run.from < run.skip_to + 1) run.from = run.skip_to + 1;
    run.skips = false;
  } else if (run.skip_to > run.to) {
    if (run.to > run.skip_from - 1) run.to = run.skip_from - 1;
    run.skips = false;
  }
  run.to = std::max(run.to, run.from - 1);
}

}  // namespace

Rectangle clip_rectangle(const Settings& s, int width, int height) {
  const bool given = s.clip_size[0] > 0 && s.clip_size[1] > 0;
  const int sides[2] = {width, height};
  Rectangle r;
  for (int i = 0; i < 2; ++i) {
    const double origin = given ? s.clip_origin[i] : 0, size = given ? s.clip_size[i] : sides[i] - 1;
    r.low[i] = std::max(static_cast<int>(std::ceil(origin)), 0);
    r.high[i] = std::min(static_cast<int>(std::floor(origin + size)), sides[i] - 1);
  }
  return r;
}

Fan::Fan(const Settings& s) : origin_{s.fan_origin[0], s.fan_origin[1]} {
  left_ = std::tan(s.fan_angles_deg[0] * kRadPerDegree);
  right_ = std::tan(s.fan_angles_deg[1] * kRadPerDegree);
  if (left_ > right_) std::swap(left_, right_);
  start2_ = s.fan_radii[0] * s.fan_radii[0];
  stop2_ = s.fan_radii[1] * s.fan_radii[1];
}

bool Fan::holds(int u, int v) const {
  const double x = u - origin_[0], y = v - origin_[1];
  if (y < 0 || x / y < left_ || x / y > right_) return false;
  const double distance2 = x * x + y * y;
  return !(distance2 < start2_ || distance2 > stop2_);
}

void Fan::narrow(int v, Run& run) const {
  const double y = v - origin_[1], beside2 = stop2_ - y * y;
  narrow_to(run, left_ * y + origin_[0] + 1, right_ * y + origin_[0] - 1);
  if (beside2 < 0) {
    run.to = run.from - 1;
    return;
  }
  const double beside = std::sqrt(beside2);
  narrow_to(run, origin_[0] - beside + 1, origin_[0] + beside - 1);
  if (start2_ - y * y > 0) {
    const double middle = std::sqrt(start2_ - y * y);
    run.skips = true;
    run.skip_from = ceiling(origin_[0] - middle + 1);
    run.skip_to = floor_of(origin_[0] + middle - 1);
  }
}

Run run_of(int v, int from, int to, const Fan& fan, const Rectangle& clip) {
  Run run{from, to, false, 0, 0};
  if (fan.on() && run.from <= run.to) fan.narrow(v, run);
  run.from = std::max(run.from, clip.low[0]);
  run.to = std::min(run.to, clip.high[0]);
  if (run.from > run.to || v < clip.low[1] || v > clip.high[1]) return {0, -1, false, 0, 0};
  settle_skip(run);
  return run;
}

}  // namespace sonocal::plus
