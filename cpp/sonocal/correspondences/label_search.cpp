#include "sonocal/correspondences/label_search.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

#include "sonocal/correspondences/label_fit.hpp"
#include "sonocal/correspondences/label_grid.hpp"
#include "sonocal/correspondences/label_samples.hpp"
#include "sonocal/correspondences/label_shift.hpp"
#include "sonocal/interrupt/interrupt.hpp"
#include "sonocal/robust/random.hpp"
#include "sonocal/solvers/batch.hpp"

namespace sonocal {
namespace {

constexpr int kDrawnFrames = 64, kCheckedFrames = 16;
constexpr int kAtOnce = 64, kMostSolutions = 4;
// Of what is scored on its own frames, the best part is refined and checked on others; the best of these
// settle.
constexpr double kRefinedShare = 0.05, kSettledShare = 0.05;
constexpr int kOwnSteps = 4;
constexpr std::size_t kWorthFitting = 5;
// So many frames say whether the others are worth looking at, as this part of what it takes says no.
constexpr int kFirstChecks = 4;
constexpr double kHopeless = 0.5;
// Where chance meets a dot of its own accord, meeting one says little: full weight from this logarithm on.
constexpr double kFullWeight = 3.0;
// An image so many times as large as all that the lines are spread over shows none of it.
constexpr double kLargestScale = 50;
constexpr double kKeptShare = 0.5;
// In thresholds: of a dot, and of the shift that a frame's share, as their poses' errors are the larger ones.
constexpr double kDotError = 0.2, kShiftError = 0.6;
// An answer that comes so near to the best one asks for that to be found so many times as often.
constexpr double kNear = 0.8;
constexpr int kAgainstNear = 3;
// Answers are one that label so large a part of their dots both, and so much of that alike.
constexpr double kSharedDots = 0.6, kSameLabels = 0.95;
constexpr std::size_t kMostCandidates = 12;

// Passes the best share of the values that it is shown.
class BestShare {
 public:
  explicit BestShare(double share) : share_(share) {}
  double least() const { return least_ * kBin; }
  bool passes(double value) {
    const double place = value / kBin;  // not a number where dots are far out of any image
    const int bin = place > 0 ? static_cast<int>(std::min(place, kBins - 1.0)) : 0;
    ++counts_[bin];
    if (++seen_ % kAgain == 0) look();
    return bin >= least_;
  }

 private:
  static constexpr int kBins = 4096, kAgain = 128;
  static constexpr double kBin = 0.0625;
  void look() {
    std::int64_t above = 0;
    int bin = kBins;
    while (bin > 0 && above + counts_[bin - 1] <= share_ * static_cast<double>(seen_))
      above += counts_[--bin];
    least_ = std::min(bin, kBins - 1);
  }

  double share_;
  int least_ = 0;
  std::int64_t seen_ = 0;
  std::array<std::int64_t, kBins> counts_{};
};

std::vector<int> frames_to_draw_from(const LabelScene& scene, std::uint64_t seed) {
  std::vector<int> frames;
  for (int f = 0; f < scene.frames(); ++f)
    if (scene.dots(f) >= 2) frames.push_back(f);
  Random random(seed);
  for (std::size_t i = frames.size(); i > 1; --i)
    std::swap(frames[i - 1], frames[random.below(static_cast<int>(i))]);
  if (frames.size() > kDrawnFrames) frames.resize(kDrawnFrames);
  return frames;
}

class Searching {
 public:
  Searching(const LabelScene& scene, const LabelSearchOptions& options)
      : scene_(scene),
        options_(options),
        reach_(options.reach / scene.size()),
        frames_(frames_to_draw_from(scene, options.seed)),
        grid_(scene, frames_),
        samples_(scene, frames_, options.seed + 1),
        start_(std::chrono::steady_clock::now()) {
    checked_.assign(frames_.begin(), frames_.begin() + std::min<std::size_t>(frames_.size(), kCheckedFrames));
    Transform one;
    const double px = scene.from_original(one).scales[0];  // 1 mm per px in units of here
    least_scale_ = options.least_scale * px;
    largest_scale_ = kLargestScale;
    if (options.largest_scale > 0) largest_scale_ = std::min(largest_scale_, options.largest_scale * px);
  }

  LabelSearch run() {
    while (!samples_.none() && out_.hypotheses < options_.most && !out_.finished && !late()) {
      allow_interrupt();
      solve_some();
      out_.finished = !out_.candidates.empty() && out_.candidates[0].finds >= finds_wanted();
    }
    for (LabelCandidate& one : out_.candidates) one.a = scene_.to_original(one.a);
    return std::move(out_);
  }

 private:
  bool late() const {
    const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start_;
    return passed.count() > options_.most_seconds;
  }

  int finds_wanted() const {
    const auto& all = out_.candidates;
    const bool near = all.size() > 1 && all[1].score > kNear * all[0].score;
    return near ? kAgainstNear * options_.finds : options_.finds;
  }

  void solve_some() {
    int drawn = 0;
    for (int tries = 0; drawn < kAtOnce && tries < 4 * kAtOnce; ++tries) {
      ++out_.hypotheses;
      if (!samples_.draw(drawn_[drawn])) continue;
      put(drawn_[drawn], drawn);
      ++drawn;
    }
    if (drawn == 0) return;
    kernels(kAtOnce).four_points(points_.data(), segments_.data(), drawn, true,
                                 {matrices_.data(), counts_.data()});
    for (int i = 0; i < drawn; ++i)
      for (int k = 0; k < counts_[i]; ++k)
        consider(read_row_major(matrices_.data() + 16 * (kMostSolutions * i + k)), drawn_[i]);
  }

  void put(const FourPairs& sample, int place) {
    for (int i = 0; i < 4; ++i) {
      const DotOnWire& pair = sample.pair[i];
      const int frame = frames_[sample.frame[i / 2]];
      const Vector2d x = scene_.dot(pair.dot);
      const Vector3d from = scene_.foot(frame, pair.wire), to = from + scene_.direction(frame, pair.wire);
      points_[8 * place + 2 * i] = x.x(), points_[8 * place + 2 * i + 1] = x.y();
      for (int axis = 0; axis < 3; ++axis) {
        segments_[24 * place + 6 * i + axis] = from[axis];
        segments_[24 * place + 6 * i + 3 + axis] = to[axis];
      }
    }
  }

  // Of what lies within reach, what chance does not bring there.
  double weight(double scale) const {
    if (!(scale > least_scale_ && scale < largest_scale_)) return 0;
    const double room = scale * scale * scene_.area_of_dot() / (M_PI * reach_ * reach_);
    return std::clamp(std::log(room), 0.0, kFullWeight) / kFullWeight;
  }

  double own_quality(const Transform& a, const FourPairs& sample) const {
    double sum = grid_.quality(a, sample.frame[0], 2 * reach_);
    if (sample.frame[1] != sample.frame[0]) sum += grid_.quality(a, sample.frame[1], 2 * reach_);
    return sum;
  }

  void consider(Transform a, const FourPairs& sample) {
    const double worth = weight(a.scales[0]);
    if (worth <= 0 || !own_.passes(worth * own_quality(a, sample))) return;
    refine_on_own(sample, a);
    if (!others_.passes(weight(a.scales[0]) * check(a))) return;
    SettledLabels settled = settle_labels(scene_, checked_, a, reach_);
    std::sort(settled.pairs.begin(), settled.pairs.end(),
              [](const DotOnWire& x, const DotOnWire& y) { return x.dot < y.dot; });
    const double score = weight(settled.a.scales[0]) * explained(settled.a);
    keep({settled.a, score, 1, std::move(settled.pairs)});
  }

  // Dots of the checked frames that are where their wires are, but for what a frame's share.
  double explained(const Transform& a) const {
    double sum = 0;
    for (int f : checked_) {
      const FrameErrors errors{kDotError * reach_, kShiftError * reach_};
      sum += scene_.dots(f) - shift_frame(scene_, a, f, reach_, errors).cost / kMostCost;
    }
    return sum;
  }

  void refine_on_own(const FourPairs& sample, Transform& a) {
    pairs_.clear();
    grid_.pairs(a, sample.frame[0], 2 * reach_, pairs_);
    if (sample.frame[1] != sample.frame[0]) grid_.pairs(a, sample.frame[1], 2 * reach_, pairs_);
    if (pairs_.size() >= kWorthFitting) fit_pairs(scene_, pairs_, kOwnSteps, a);
  }

  double check(const Transform& a) const {
    double sum = 0;
    const int count = static_cast<int>(checked_.size());
    for (int k = 0; k < count; ++k) {
      sum += grid_.quality(a, k, 2 * reach_);
      if (k + 1 >= kFirstChecks && sum * count < kHopeless * others_.least() * (k + 1)) break;
    }
    return sum;
  }

  // Whether two answers are one: by their labels, as what the dots tell little of may differ by much.
  bool alike(const LabelCandidate& one, const LabelCandidate& other) const {
    if (scene_.apart(one.a, other.a) < reach_) return true;
    std::size_t both = 0, same = 0;
    for (std::size_t i = 0, j = 0; i < one.pairs.size() && j < other.pairs.size();) {
      const DotOnWire &x = one.pairs[i], &y = other.pairs[j];
      if (x.dot == y.dot) ++both, same += x.wire == y.wire;
      i += x.dot <= y.dot;
      j += y.dot <= x.dot;
    }
    const double most = static_cast<double>(std::max(one.pairs.size(), other.pairs.size()));
    return static_cast<double>(both) > kSharedDots * most && static_cast<double>(same) > kSameLabels * both;
  }

  void keep(LabelCandidate found) {
    auto& all = out_.candidates;
    const auto known =
        std::find_if(all.begin(), all.end(), [&](const LabelCandidate& one) { return alike(one, found); });
    if (known == all.end()) {
      if (!all.empty() && found.score < kKeptShare * all[0].score) return;
      all.push_back(std::move(found));
    } else {
      found.finds = known->finds + 1;
      if (found.score > known->score)
        *known = std::move(found);
      else
        known->finds = found.finds;
    }
    std::stable_sort(all.begin(), all.end(),
                     [](const LabelCandidate& x, const LabelCandidate& y) { return x.score > y.score; });
    if (all.size() > kMostCandidates) all.pop_back();
  }

  const LabelScene& scene_;
  const LabelSearchOptions& options_;
  const double reach_;
  const std::vector<int> frames_;
  const LabelGrid grid_;
  LabelSamples samples_;
  const std::chrono::steady_clock::time_point start_;
  double least_scale_, largest_scale_;
  std::vector<int> checked_;
  BestShare own_{kRefinedShare}, others_{kSettledShare};
  std::array<FourPairs, kAtOnce> drawn_;
  std::array<double, kAtOnce * 8> points_;
  std::array<double, kAtOnce * 24> segments_;
  std::array<double, kAtOnce * kMostSolutions * 16> matrices_;
  std::array<std::int64_t, kAtOnce> counts_;
  std::vector<DotOnWire> pairs_;
  LabelSearch out_;
};

}  // namespace

LabelSearch search_labels(const LabelScene& scene, const LabelSearchOptions& options) {
  return Searching(scene, options).run();
}

}  // namespace sonocal
