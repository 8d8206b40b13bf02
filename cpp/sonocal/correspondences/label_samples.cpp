#include "sonocal/correspondences/label_samples.hpp"

#include <cmath>

namespace sonocal {
namespace {

// Of the spread of four dots: less across than this part of it along, and the plane's turn about that line is
// anybody's guess.
constexpr double kLeastAcross = 0.08;

}  // namespace

LabelSamples::LabelSamples(const LabelScene& scene, const std::vector<int>& frames, std::uint64_t seed)
    : scene_(scene), frames_(frames), random_(seed) {
  for (std::size_t place = 0; place < frames.size(); ++place) {
    const int dots = scene.dots(frames[place]);
    if (dots >= 4 && scene.wires() >= 4) fours_.push_back(static_cast<int>(place));
    if (dots >= 2 && scene.wires() >= 2) pairs_.push_back(static_cast<int>(place));
  }
  if (pairs_.size() < 2) pairs_.clear();
}

// Different dots of a frame on different wires.
void LabelSamples::draw_from(int place, int count, DotOnWire* out) {
  const int frame = frames_[place];
  for (int i = 0; i < count; ++i) {
    bool taken = true;
    while (taken) {
      out[i] = {scene_.first(frame) + random_.below(scene_.dots(frame)), random_.below(scene_.wires()), 0};
      taken = false;
      for (int j = 0; j < i; ++j) taken |= out[j].dot == out[i].dot || out[j].wire == out[i].wire;
    }
  }
}

bool LabelSamples::draw(FourPairs& out) {
  from_one_ = pairs_.empty() || (!from_one_ && !fours_.empty());
  if (from_one_) {
    out.frame[0] = out.frame[1] = fours_[random_.below(static_cast<int>(fours_.size()))];
    draw_from(out.frame[0], 4, out.pair.data());
  } else {
    const int count = static_cast<int>(pairs_.size()), one = random_.below(count);
    out.frame = {pairs_[one], pairs_[(one + 1 + random_.below(count - 1)) % count]};
    draw_from(out.frame[0], 2, out.pair.data());
    draw_from(out.frame[1], 2, out.pair.data() + 2);
  }
  return spread(out);
}

bool LabelSamples::spread(const FourPairs& sample) const {
  Vector2d mean = Vector2d::Zero();
  for (const DotOnWire& pair : sample.pair) mean += 0.25 * scene_.dot(pair.dot);
  double uu = 0, uv = 0, vv = 0;
  for (const DotOnWire& pair : sample.pair) {
    const Vector2d x = scene_.dot(pair.dot) - mean;
    uu += x.x() * x.x(), uv += x.x() * x.y(), vv += x.y() * x.y();
  }
  const double half = 0.5 * (uu + vv), root = std::sqrt(0.25 * (uu - vv) * (uu - vv) + uv * uv);
  return half - root > kLeastAcross * kLeastAcross * (half + root);
}

}  // namespace sonocal
