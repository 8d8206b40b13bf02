#include "sonocal/estimate/samplers.hpp"

#include <algorithm>

#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/gauss_newton.hpp"
#include "sonocal/solvers/three_quadrics.hpp"
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

ImageRows::ImageRows(const PointLines& rows, Labels labels, double scale) : rows_(rows), scale_(scale) {
  labels_.frame = if_various(labels.frame, rows.size(), sample_size());
  labels_.target = if_various(labels.target, rows.size(), sample_size());
}

bool ImageRows::repeats(const Sample& sample, int drawn, int candidate) const {
  return std::any_of(sample.begin(), sample.begin() + drawn, [&](int row) {
    return (labels_.frame && labels_.frame[row] == labels_.frame[candidate]) ||
           (labels_.target && labels_.target[row] == labels_.target[candidate]);
  });
}

void ImageRows::draw_one(Random& random, Sample& sample) const {
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

void ImageRows::solve_fours(const Sample* samples, int count, BatchOut out) const {
  std::array<double, kAhead * 4 * 2> points;
  std::array<double, kAhead * 4 * 6> segments;
  for (int i = 0; i < 4 * count; ++i) {
    const int row = samples[i / 4][i % 4];
    const Vector3d foot = rows_.foot(row), ends[2] = {foot, foot + rows_.direction(row)};
    std::copy_n(rows_.point(row).data(), 2, &points[i * 2]);
    for (int end = 0; end < 2; ++end) std::copy_n(ends[end].data(), 3, &segments[i * 6 + 3 * end]);
  }
  four_points_batch(points.data(), segments.data(), count, NoRealRoot::kRealPart, 1, out);
}

void ImageRows::solve_threes(const Sample* samples, int count, BatchOut out) const {
  std::array<double, kAhead * 6 * 3> points;
  std::array<double, kAhead * 6 * 4> planes;
  for (int i = 0; i < 3 * count; ++i) {
    const int row = samples[i / 3][i % 3];
    PointOnPlane both[2];
    planes_of_line(rows_.point(row), rows_.foot(row), rows_.direction(row), both);
    for (int k = 0; k < 2; ++k) {
      std::copy_n(both[k].point.data(), 3, &points[(2 * i + k) * 3]);
      std::copy_n(both[k].normal.data(), 3, &planes[(2 * i + k) * 4]);
      planes[(2 * i + k) * 4 + 3] = both[k].offset;
    }
  }
  three_quadrics_batch(points.data(), planes.data(), count, 6, scale_, NoRealRoot::kRealPart, 1, out);
}

void ImageRows::solve_samples(const Sample* samples, int count, BatchOut out) const {
  scale_ > 0 ? solve_threes(samples, count, out) : solve_fours(samples, count, out);
}

void ImageRows::draw(Random& random, Sample& sample) {
  if (next_ == kAhead) {
    for (Sample& one : samples_) draw_one(random, one);
    solve_samples(samples_.data(), kAhead, {matrices_.data(), counts_.data()});
    next_ = 0;
  }
  sample = samples_[next_++];
  drawn_ = true;
}

int ImageRows::solve(const Sample& sample, Random&, Candidates& out) {
  // Of the sample drawn last there are answers already; where all combinations are gone through, of none.
  const bool ahead = drawn_ && sample == samples_[next_ - 1];
  const int at = ahead ? next_ - 1 : 0;
  if (!ahead) {
    solve_samples(&sample, 1, {matrices_.data(), counts_.data()});
    next_ = kAhead;
    drawn_ = false;
  }
  const int count = static_cast<int>(counts_[at]);
  for (int i = 0; i < count; ++i) out[i] = read_row_major(&matrices_[(at * most() + i) * 16]);
  return count;
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
