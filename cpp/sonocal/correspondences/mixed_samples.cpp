#include "sonocal/correspondences/mixed_samples.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "sonocal/linalg/ldlt.hpp"
#include "sonocal/linalg/small.hpp"
#include "sonocal/solvers/three_points.hpp"
#include "sonocal/solvers/two_conics.hpp"
#include "sonocal/solvers/two_lines.hpp"

namespace sonocal {
namespace {

constexpr int kMostMotions = 7;
// A kind of fewer is not drawn from alone, nor is one of which fewer motions are held by each.
constexpr int kEnough = 8, kStrong = 3;
// Noise parts a pair of roots in one sample of twenty: few samples cannot do without what is nearest to them,
// of many there are others.
constexpr int kFewSamples = 64;
// Samples without one that determines a similarity show that none of their size does.
constexpr int kLooked = 64;
// By then all are drawn from, however their weights differ.
constexpr int kRamp = 200;
// Information this small beside the largest, in coordinates of order one, leaves a motion free.
constexpr double kFree = 1e-12;
// Planes of a sample that pass a point so closely, beside all correspondences', meet.
constexpr double kMeeting = 1e-6;

// Root mean square distance of the planes from the point nearest to all of them: nothing but this size tells
// a similarity from one that shrinks the source to that point.
double spread_of(const std::vector<PointOnPlane>& rows) {
  Matrix3d normals = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const auto& row : rows) {
    normals += row.normal * row.normal.transpose();
    right -= row.offset * row.normal;
  }
  const Vector3d nearest = least_squares(normals, right);
  double sum = 0;
  for (const auto& row : rows) sum += std::pow(row.normal.dot(nearest) + row.offset, 2);
  return std::sqrt(sum / static_cast<double>(rows.size()));
}

// Whether the rows hold all seven motions about `a`; of a known scale, the other six.
bool hold_all(const std::vector<PointOnPlane>& rows, const Transform& a, bool scale_known) {
  Vector3d centre = Vector3d::Zero();
  for (const auto& row : rows) centre += row.point / static_cast<double>(rows.size());
  double size = 0;
  for (const auto& row : rows) size = std::max(size, (row.point - centre).norm());
  Eigen::Matrix<double, kMostMotions, kMostMotions> information =
      Eigen::Matrix<double, kMostMotions, kMostMotions>::Zero();
  for (const auto& row : rows) {
    const Vector3d arm = a.rotation * (row.point - centre) / size;
    Eigen::Matrix<double, kMostMotions, 1> jacobian;
    jacobian << cross(arm, row.normal), row.normal, scale_known ? 0.0 : row.normal.dot(arm);
    for (int column = 0; column < kMostMotions; ++column)
      information.col(column) += jacobian[column] * jacobian;
  }
  if (!information.allFinite()) return false;
  if (scale_known) information(6, 6) = information.trace() / 6;
  const Ldlt<kMostMotions> factors(information);
  return factors.least_pivot() > kFree * factors.greatest_pivot();
}

// The kind that holds most, where there are enough of it and others; -1: none is drawn from alone.
int strongest(const std::vector<UnitKind>& kinds) {
  int best = -1;
  for (int k = 0; k < static_cast<int>(kinds.size()); ++k)
    if (kinds.size() > 1 && kinds[k].units.size() >= kEnough && kinds[k].held() >= kStrong &&
        (best < 0 || kinds[k].held() > kinds[best].held()))
      best = k;
  return best;
}

void put_row(const PointOnPlane& row, double* point, double* plane) {
  for (int axis = 0; axis < 3; ++axis) {
    point[axis] = row.point[axis];
    plane[axis] = row.normal[axis];
  }
  plane[3] = row.offset;
}

}  // namespace

MixedSamples::MixedSamples(const UnitRows& rows, const double* weights, double scale)
    : rows_(rows),
      scale_(scale),
      motions_(scale > 0 ? kMostMotions - 1 : kMostMotions),
      flat_(rows.flat()),
      strongest_kind_(strongest(rows.kinds())) {
  for (int slot = 0; slot < rows.slots(); ++slot)
    if (rows.unit(slot) >= 0) order_.push_back(slot);
  ordered_ = weights && *std::min_element(weights, weights + rows.units()) <
                            *std::max_element(weights, weights + rows.units());
  if (ordered_)
    std::stable_sort(order_.begin(), order_.end(),
                     [&](int a, int b) { return weights[rows.unit(a)] > weights[rows.unit(b)]; });
  std::vector<PointOnPlane> all;
  for (const int slot : order_) {
    if (strongest_kind_ >= 0 && &rows.kind(slot) == &rows.kinds()[strongest_kind_])
      strongest_.push_back(slot);
    for (int j = 0; j < rows.kind(slot).rows(); ++j) all.push_back(rows.row(slot, j));
  }
  spread_ = spread_of(all);
}

int MixedSamples::most_units() const { return std::min(kMostUnits, rows_.units()); }

int MixedSamples::pool(int size) const {
  if (!ordered_ || samples_ >= kRamp) return size;
  return std::clamp(static_cast<int>(static_cast<std::int64_t>(size) * (samples_ + 1) / kRamp),
                    std::min(size, 2 * kMostUnits), size);
}

void MixedSamples::draw_one(Random& random, Drawn& out) {
  const std::vector<int>& from = strongest_.empty() || random.below(2) == 0 ? order_ : strongest_;
  const int size = pool(static_cast<int>(from.size())), most = std::min(kMostUnits, size);
  out.size = 0;
  for (int held = 0, beyond = 0; out.size < most && (held < motions_ || beyond < extra_);) {
    const int slot = from[random.below(size)];
    const auto end = out.slot.begin() + out.size;
    if (std::find(out.slot.begin(), end, slot) != end) continue;
    out.slot[out.size++] = slot;
    beyond += held >= motions_;
    held += this->held(rows_.kind(slot));
  }
  out.by = solver_of(out);
  ++samples_;
}

MixedSamples::By MixedSamples::solver_of(const Drawn& drawn) const {
  const auto all = [&](const auto& is) {
    return std::all_of(drawn.slot.begin(), drawn.slot.begin() + drawn.size, is);
  };
  if (drawn.size == 2 && all([&](int slot) { return rows_.kind(slot).line; })) return By::kLines;
  if (drawn.size == 3 && all([&](int slot) { return rows_.kind(slot).point; })) return By::kPoints;
  return By::kRows;
}

void MixedSamples::put_points(const Drawn& drawn, double* points, double* places) const {
  for (int i = 0; i < 3; ++i) {
    const PointOnPlane first = rows_.row(drawn.slot[i], 0);
    const Vector3d place = target_point(first, rows_.row(drawn.slot[i], 1), rows_.row(drawn.slot[i], 2));
    std::copy_n(first.point.data(), 3, points + 3 * i);
    std::copy_n(place.data(), 3, places + 3 * i);
  }
}

void MixedSamples::put_lines(const Drawn& drawn, double* image, double* needles) const {
  for (int i = 0; i < 2; ++i) {
    const PointOnPlane first = rows_.row(drawn.slot[i], 0), other = rows_.row(drawn.slot[i], 1);
    const TargetLine line = target_line(first, other);
    const Vector3d end = rows_.row(drawn.slot[i], 2).point, on = line.foot + line.direction;
    std::copy_n(first.point.data(), 3, image + 6 * i);
    std::copy_n(end.data(), 3, image + 6 * i + 3);
    std::copy_n(line.foot.data(), 3, needles + 6 * i);
    std::copy_n(on.data(), 3, needles + 6 * i + 3);
  }
}

// So many rows as motions, one of each correspondence in turn; the last again where there are fewer. Each has
// another one first: the same planes of points on points are parallel.
void MixedSamples::put_rows(const Drawn& drawn, double* points, double* planes) const {
  int taken = 0;
  for (int round = 0, found = 1; found && taken < motions_; ++round) {
    found = 0;
    for (int u = 0; u < drawn.size && taken < motions_; ++u) {
      const int rows = rows_.kind(drawn.slot[u]).rows();
      if (round >= rows) continue;
      put_row(rows_.row(drawn.slot[u], (round + u) % rows), points + 3 * taken, planes + 4 * taken);
      ++taken;
      found = 1;
    }
  }
  for (; taken < motions_; ++taken) {
    std::copy_n(points + 3 * (taken - 1), 3, points + 3 * taken);
    std::copy_n(planes + 4 * (taken - 1), 4, planes + 4 * taken);
  }
}

void MixedSamples::solve_ahead() {
  std::array<double, kAhead * kMostMotions * 3> points;
  std::array<double, kAhead * kMostMotions * 4> planes;
  std::array<double, kAhead * 12> image, needles;
  std::array<double, kAhead * 9> seen, places;
  int lines = 0, threes = 0, others = 0;
  for (Drawn& drawn : drawn_) {
    drawn.place = drawn.by == By::kLines ? lines++ : drawn.by == By::kPoints ? threes++ : others++;
    if (drawn.by == By::kLines)
      put_lines(drawn, &image[12 * drawn.place], &needles[12 * drawn.place]);
    else if (drawn.by == By::kPoints)
      put_points(drawn, &seen[9 * drawn.place], &places[9 * drawn.place]);
    else
      put_rows(drawn, &points[3 * motions_ * drawn.place], &planes[4 * motions_ * drawn.place]);
  }
  const bool few = samples_ <= kFewSamples || extra_ > 0;
  const NoRealRoot policy = few ? NoRealRoot::kRealPart : NoRealRoot::kNothing;
  if (lines > 0)
    two_lines_batch(image.data(), needles.data(), lines, 1, {line_matrices_.data(), line_counts_.data()});
  if (threes > 0)
    three_points_batch(seen.data(), places.data(), threes, scale_, 1,
                       {point_matrices_.data(), point_counts_.data()});
  if (others == 0) return;
  const BatchOut out{matrices_.data(), counts_.data()};
  if (by_conics())
    two_conics_batch(points.data(), planes.data(), others, motions_, policy, 1, out);
  else
    three_quadrics_batch(points.data(), planes.data(), others, motions_, scale_, policy, 1, out);
}

int MixedSamples::determined_ahead() const {
  Models models;
  std::vector<PointOnPlane> rows;
  int determined = 0;
  for (const Drawn& drawn : drawn_) {
    if (solutions(drawn, models) == 0) continue;
    read_rows(drawn, rows);
    determined += determine(rows, models[0]);
  }
  return determined;
}

// Lines that meet, and planes of few directions, hold less than they have rows: the first samples tell how
// many of them determine a similarity. Where none does, one more correspondence joins each.
void MixedSamples::look(Random& random) {
  for (; extra_ < most_units(); ++extra_)
    for (int looked = kAhead; looked <= kLooked; looked += kAhead) {
      for (Drawn& drawn : drawn_) draw_one(random, drawn);
      solve_ahead();
      determined_ = static_cast<double>(determined_ahead()) / looked;
      if (determined_ > 0) return;
    }
}

void MixedSamples::draw_ahead(Random& random) {
  next_ = 0;
  if (samples_ == 0) return look(random);
  for (Drawn& drawn : drawn_) draw_one(random, drawn);
  solve_ahead();
}

void MixedSamples::draw(Random& random) {
  if (++next_ >= kAhead) draw_ahead(random);
  sample_rows_of_ = -1;
}

int MixedSamples::solutions(const Drawn& drawn, Models& out) const {
  const auto read = [&](const double* matrices, const std::int64_t* counts, int most) {
    const int count = static_cast<int>(counts[drawn.place]);
    for (int i = 0; i < count; ++i) out[i] = read_row_major(matrices + 16 * (most * drawn.place + i));
    return count;
  };
  if (drawn.by == By::kLines) return read(line_matrices_.data(), line_counts_.data(), 2);
  if (drawn.by == By::kPoints) return read(point_matrices_.data(), point_counts_.data(), 1);
  return read(matrices_.data(), counts_.data(), by_conics() ? 4 : 8);
}

int MixedSamples::solve(Models& out) const { return solutions(drawn_[next_], out); }

void MixedSamples::read_rows(const Drawn& drawn, std::vector<PointOnPlane>& out) const {
  out.clear();
  for (int u = 0; u < drawn.size; ++u)
    for (int j = 0; j < rows_.kind(drawn.slot[u]).rows(); ++j) out.push_back(rows_.row(drawn.slot[u], j));
}

const std::vector<PointOnPlane>& MixedSamples::rows() {
  if (sample_rows_of_ != next_) read_rows(drawn_[next_], sample_rows_);
  sample_rows_of_ = next_;
  return sample_rows_;
}

bool MixedSamples::determine(const std::vector<PointOnPlane>& rows, const Transform& a) const {
  // Of a known scale planes may meet: nothing can shrink to where they do.
  return static_cast<int>(rows.size()) >= motions_ && (scale_ > 0 || spread_of(rows) > kMeeting * spread_) &&
         hold_all(rows, a, scale_ > 0);
}

bool MixedSamples::determine(const Transform& a) { return determine(rows(), a); }

double MixedSamples::clean_share(const std::vector<double>& sound) const {
  const double any = clean_share(sound, -1);
  return determined_ * (strongest_.empty() ? any : 0.5 * (any + clean_share(sound, strongest_kind_)));
}

// Of samples of any kinds, or of one. clean[h]: that what joins a sample which holds h motions is sound.
double MixedSamples::clean_share(const std::vector<double>& sound, int only) const {
  const auto& kinds = rows_.kinds();
  std::array<double, kMostMotions + 1> clean;
  double one = 0;
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const double part = static_cast<double>(kinds[k].units.size()) / rows_.units();
    one += only < 0 ? part * sound[k] : only == static_cast<int>(k) ? sound[k] : 0;
  }
  clean[motions_] = std::pow(one, extra_);
  for (int h = motions_ - 1; h >= 0; --h) {
    clean[h] = 0;
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      const double part =
          only < 0 ? static_cast<double>(kinds[k].units.size()) / rows_.units() : only == static_cast<int>(k);
      clean[h] += part * sound[k] * clean[std::min(h + held(kinds[k]), motions_)];
    }
  }
  return clean[0];
}

}  // namespace sonocal
