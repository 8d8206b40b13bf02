#include "sonocal/estimate/samplers.hpp"

#include <algorithm>

#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/two_lines.hpp"

namespace sonocal {
namespace {

// A row that repeats the sample's frames or wires is drawn again this often, then taken.
constexpr int kTries = 8;

// Labels with fewer different values than a sample has rows cannot all differ in it.
const std::int32_t* if_various(const std::int32_t* labels, int rows, int needed) {
  if (labels == nullptr || rows == 0) return nullptr;
  return 1 + *std::max_element(labels, labels + rows) >= needed ? labels : nullptr;
}

}  // namespace

FourRows::FourRows(const PointLines& rows, Labels labels) : rows_(rows) {
  labels_.frame = if_various(labels.frame, rows.size(), sample_size());
  labels_.target = if_various(labels.target, rows.size(), sample_size());
}

bool FourRows::repeats(const Sample& sample, int drawn, int candidate) const {
  return std::any_of(sample.begin(), sample.begin() + drawn, [&](int row) {
    return (labels_.frame && labels_.frame[row] == labels_.frame[candidate]) ||
           (labels_.target && labels_.target[row] == labels_.target[candidate]);
  });
}

void FourRows::draw_one(Random& random, Sample& sample) const {
  for (int drawn = 0; drawn < sample_size(); ++drawn) {
    int candidate = 0;
    for (int tries = 0;; ++tries) {
      candidate = random.below(units());
      if (std::find(sample.begin(), sample.begin() + drawn, candidate) != sample.begin() + drawn) continue;
      if (tries >= kTries || !repeats(sample, drawn, candidate)) break;
    }
    sample[drawn] = candidate;
  }
}

void FourRows::draw_ahead(Random& random) {
  std::array<double, kAhead * 4 * 2> points;
  std::array<double, kAhead * 4 * 6> segments;
  for (int s = 0; s < kAhead; ++s) {
    draw_one(random, samples_[s]);
    for (int i = 0; i < 4; ++i) {
      const int row = samples_[s][i];
      const Vector3d foot = rows_.foot(row), ends[2] = {foot, foot + rows_.direction(row)};
      std::copy_n(rows_.point(row).data(), 2, &points[(s * 4 + i) * 2]);
      for (int end = 0; end < 2; ++end)
        std::copy_n(ends[end].data(), 3, &segments[(s * 4 + i) * 6 + 3 * end]);
    }
  }
  four_points_batch(points.data(), segments.data(), kAhead, NoRealRoot::kRealPart, 1,
                    {matrices_.data(), counts_.data()});
  next_ = 0;
}

void FourRows::draw(Random& random, Sample& sample) {
  if (next_ == kAhead) draw_ahead(random);
  sample = samples_[next_++];
  drawn_ = true;
}

int FourRows::solve(const Sample& sample, Random&, Candidates& out) {
  if (drawn_) {
    const int at = next_ - 1, count = static_cast<int>(counts_[at]);
    for (int i = 0; i < count; ++i) out[i] = read_row_major(&matrices_[(at * 4 + i) * 16]);
    return count;
  }
  std::array<PointOnLine, 4> problem;
  for (int i = 0; i < 4; ++i) {
    problem[i] = {rows_.point(sample[i]).head<2>(), rows_.foot(sample[i]), rows_.direction(sample[i])};
  }
  return four_points(problem, out, NoRealRoot::kRealPart);
}

Vector3d FourRows::centre(const Sample& sample) const {
  Vector3d sum = Vector3d::Zero();
  for (int i = 0; i < sample_size(); ++i) sum += rows_.point(sample[i]) / sample_size();
  return sum;
}

TwoSightings::TwoSightings(const PointLines& rows, const Sightings& sightings)
    : rows_(rows), sightings_(sightings) {
  for (int i = 0; i < sightings.size(); ++i) {
    const int size = sightings[i].size();
    if (size < 2) continue;
    pairs_only_ = pairs_only_ && size == 2;
    lines_.push_back(i);
  }
}

void TwoSightings::draw(Random& random, Sample& sample) const {
  sample[0] = random.below(units());
  sample[1] = random.below(units() - 1);
  sample[1] += sample[1] >= sample[0];
}

Vector3d TwoSightings::centre(const Sample& sample) const {
  Vector3d sum = Vector3d::Zero();
  for (int i = 0; i < sample_size(); ++i) {
    const Sightings::Range members = sightings_[lines_[sample[i]]];
    for (const int row : members) sum += rows_.point(row) / (sample_size() * members.size());
  }
  return sum;
}

int TwoSightings::solve(const Sample& sample, Random& random, Candidates& out) const {
  std::array<Line, 2> image, needles;
  for (int i = 0; i < 2; ++i) {
    const Sightings::Range members = sightings_[lines_[sample[i]]];
    int a = 0, b = 1;
    if (members.size() > 2) {
      a = random.below(members.size());
      b = random.below(members.size() - 1);
      b += b >= a;
    }
    const Vector3d first = rows_.point(members[a]), second = rows_.point(members[b]);
    image[i] = {first, (second - first).normalized()};
    needles[i] = {rows_.foot(members[a]), rows_.direction(members[a])};
  }
  std::array<Transform, 2> both;
  const int count = two_lines(image, needles, both);
  std::copy_n(both.begin(), count, out.begin());
  return count;
}

}  // namespace sonocal
