#include "sonocal/correspondences/chance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include "sonocal/linalg/sort_by.hpp"

namespace sonocal {
namespace {

// Pairs of one kind that are looked at: a share of 1 % is known to a third of itself.
constexpr int kMostPairs = 1200;
// A kind of fewer has its sources held against targets of all kinds.
constexpr int kFewOfAKind = 4;
// Distances below this many of the pairs' least follow a power law.
constexpr int kFewestInTail = 8, kTailPart = 10;
// Distances at which the number of false alarms is looked for.
constexpr int kMostDistances = 100;
constexpr double kMotions = 7;
// Three quadrics have as many solutions.
const double kLogSolutions = std::log(8.0);
constexpr double kNever = std::numeric_limits<double>::infinity(), kLeast = 1e-300;
// Where all agree, less is asked of few rows to spare, which cannot show more: with residuals of this part of
// the scene's size (root mean square), as noise of 0.4 mm in a scene 200 mm wide leaves them; and
// of planes on planes, that have no size, with one to spare.
constexpr double kNoise = 4e-3;
const double kLikelyNoise = std::log(0.05), kLikelyPlanes = std::log(0.01);

struct Kind {
  int rows, points;
  bool operator<(const Kind& other) const {
    return rows != other.rows ? rows < other.rows : points < other.points;
  }
};

double log_choose(double n, double k) {
  return std::lgamma(n + 1) - std::lgamma(k + 1) - std::lgamma(n - k + 1);
}

// log of the probability that k or more of n agree, each with probability p; 0 where k is no more than
// expected. The tail falls faster than the geometric series that its first two terms begin.
double log_binomial_tail(int k, int n, double p) {
  if (k <= 0 || p >= 1) return 0;
  if (k > n) return -std::numeric_limits<double>::infinity();
  const double ratio = (n - k) * p / ((k + 1) * (1 - p));
  if (ratio >= 1) return 0;
  const double first = log_choose(n, k) + k * std::log(p) + (n - k) * std::log1p(-p);
  return std::min(first - std::log1p(-ratio), 0.0);
}

// What a kind's squared distances are where chance has paired it: how likely is one below a limit?
class Background {
 public:
  Background(std::vector<double> squares, const Kind& kind) : pairs_(static_cast<int>(squares.size())) {
    const int tail = std::min(std::max(kFewestInTail, pairs_ / kTailPart), pairs_);
    std::sort(squares.begin(), squares.end());
    squares_ = std::move(squares);
    if (tail == 0) return;
    anchor_ = squares_[tail - 1];
    at_anchor_ = tail / (pairs_ + 1.0);
    // Hill's estimate of the power, on the safe side of its error, between what one point and all rows give.
    double sum = 0;
    for (int i = 0; i + 1 < tail; ++i) sum += 0.5 * std::log(anchor_ / std::max(squares_[i], 1e-300));
    const double power = sum > 0 ? (tail - 1) / sum * (1 - 1 / std::sqrt(tail)) : kind.rows;
    power_ = std::clamp(power, static_cast<double>(kind.rows) / kind.points, static_cast<double>(kind.rows));
  }

  double share_below(double square) const {
    if (pairs_ == 0) return 1;
    if (square < anchor_) return at_anchor_ * std::pow(square / anchor_, 0.5 * power_);
    const auto count = std::upper_bound(squares_.begin(), squares_.end(), square) - squares_.begin();
    return std::min((count + 1.0) / (pairs_ + 1.0), 1.0);
  }

 private:
  int pairs_;
  std::vector<double> squares_;
  double anchor_ = 0, at_anchor_ = 1, power_ = 1;
};

class Pairing {
 public:
  Pairing(const Correspondences& all, const Transform& transform) : all_(all) {
    const Matrix3d s = transform.linear();
    mapped_.resize(all.first[all.count]);
    for (std::size_t i = 0; i < mapped_.size(); ++i)
      mapped_[i] = s * Eigen::Map<const Vector3d>(all.points + 3 * i) + transform.translation;
    for (int c = 0; c < all.count; ++c) kinds_[kind_of(c)].push_back(c);
  }

  const std::map<Kind, std::vector<int>>& kinds() const { return kinds_; }

  // Root mean square distance of the mapped points from their centre.
  double size() const {
    Vector3d centre = Vector3d::Zero();
    for (const Vector3d& point : mapped_) centre += point / static_cast<double>(mapped_.size());
    double sum = 0;
    for (const Vector3d& point : mapped_) sum += (point - centre).squaredNorm();
    return std::sqrt(sum / static_cast<double>(mapped_.size()));
  }

  Background background(const Kind& kind, const std::vector<int>& of_kind) const {
    std::vector<int> everything;
    if (of_kind.size() < kFewOfAKind) {
      everything.resize(all_.count);
      std::iota(everything.begin(), everything.end(), 0);
    }
    const std::vector<int>& others = everything.empty() ? of_kind : everything;
    const auto count = static_cast<std::int64_t>(of_kind.size()),
               most = static_cast<std::int64_t>(others.size());
    const std::int64_t sampled = std::min<std::int64_t>(count, kMostPairs);
    const std::int64_t shifts =
        std::clamp<std::int64_t>(kMostPairs / sampled, 1, std::max<std::int64_t>(most - 1, 1));
    std::vector<double> squares;
    squares.reserve(sampled * shifts);
    for (std::int64_t i = 0; i < sampled; ++i) {
      const std::int64_t place = i * count / sampled;
      const int target = of_kind[place];
      for (std::int64_t j = 0; j < shifts; ++j) {
        const int source = others[(place + 1 + (2 * j + 1) * (most - 1) / (2 * shifts)) % most];
        if (source != target) squares.push_back(square(source, target, kind));
      }
    }
    return Background(std::move(squares), kind);
  }

 private:
  Kind kind_of(int c) const {
    const int begin = all_.first[c], end = all_.first[c + 1];
    int points = 1;
    for (int i = begin + 1; i < end; ++i) points += mapped_[i] != mapped_[i - 1];
    return {end - begin, points};
  }

  Vector3d centre_of(int c) const {
    Vector3d sum = Vector3d::Zero();
    for (int i = all_.first[c]; i < all_.first[c + 1]; ++i) sum += mapped_[i];
    return sum / (all_.first[c + 1] - all_.first[c]);
  }

  // Mean squared distance of one correspondence's source from another's target; of the target's own source
  // moved there where the two are not of one kind.
  double square(int source, int target, const Kind& kind) const {
    const int begin = all_.first[target], from = all_.first[source];
    const bool alike = all_.first[source + 1] - from == kind.rows && kind_of(source).points == kind.points;
    const Vector3d moved = alike ? Vector3d::Zero() : Vector3d(centre_of(source) - centre_of(target));
    double sum = 0;
    for (int i = 0; i < kind.rows; ++i) {
      const double* plane = all_.planes + 4 * (begin + i);
      const Vector3d point = alike ? mapped_[from + i] : Vector3d(mapped_[begin + i] + moved);
      const double r = plane[0] * point.x() + plane[1] * point.y() + plane[2] * point.z() + plane[3];
      sum += r * r;
    }
    return sum / kind.points;
  }

  const Correspondences& all_;
  std::vector<Vector3d> mapped_;
  std::map<Kind, std::vector<int>> kinds_;
};

// A correspondence that agrees.
struct Agreeing {
  double chance;   // of a pair to be as near
  double square;   // of all its rows' distances
  double density;  // log of what pairs have about no distance at all, by each of its rows
  int rows, held;  // of a plane only two rows are worth it: three planes on three planes leave a growth
};

double log_ball(double dimension) {
  return 0.5 * dimension * std::log(M_PI) - std::lgamma(0.5 * dimension + 1);
}

std::vector<Agreeing> agreeing_of(const Pairing& pairing, const double* squares, double limit, double& share,
                                  int count) {
  std::vector<Agreeing> out;
  for (const auto& [kind, of_kind] : pairing.kinds()) {
    const Background background = pairing.background(kind, of_kind);
    share += background.share_below(limit) * static_cast<double>(of_kind.size()) / count;
    const std::size_t begin = out.size();
    double sum = 0;
    for (const int c : of_kind) {
      if (!(squares[c] <= limit)) continue;
      const double square = squares[c] * kind.points;
      sum += square;
      out.push_back({background.share_below(squares[c]), square, 0, kind.rows,
                     kind.points == 3 ? kind.rows - 1 : kind.rows});
    }
    const double typical = std::max(sum / static_cast<double>(out.size() - begin), kLeast);
    const double density = std::log(background.share_below(typical / kind.points)) - log_ball(kind.rows) -
                           0.5 * kind.rows * std::log(typical);
    for (std::size_t i = begin; i < out.size(); ++i) out[i].density = density;
  }
  sort_by(out, [](const auto& one) { return one.chance; });
  return out;
}

// Sums over the nearest of those that agree.
struct Nearest {
  int count = 0, rows = 0;
  double square = 0, density = 0;

  void add(const Agreeing& one) {
    ++count;
    rows += one.rows;
    square += one.square;
    density += one.density;
  }
  int spare() const { return rows - static_cast<int>(kMotions); }
  // Log of how many similarities bring so many of all so near by chance: least squares over all rows, whose
  // residual lies in a ball of as many dimensions as there are rows to spare. All samples of seven rows
  // together are worth the root of their number (the determinant of J'J is the sum of their squared ones).
  double log_alarms(int all) const {
    if (spare() <= 0) return kNever;
    return log_choose(all, count) + 0.5 * log_choose(rows, kMotions) + log_ball(spare()) +
           0.5 * spare() * std::log(std::max(square, kLeast)) + spare() * density / rows;
  }
  // Whether it is what noise may leave, in all but a few of a hundred.
  bool like_noise(double deviation) const {
    const double k = spare();
    return square <= deviation * deviation * (k + 2 * std::sqrt(2 * k) + 2);
  }
};

}  // namespace

int sample_of(int agreeing, double rows) {
  return std::clamp(static_cast<int>(std::ceil(kMotions * agreeing / rows)), 1, agreeing);
}

double log_alarms(int count, int agreeing, int sample, double share) {
  return std::log(count - sample) + log_choose(count, sample) + kLogSolutions +
         log_binomial_tail(agreeing - sample, count - sample, share);
}

Agreement agreement(const Correspondences& all, const Transform& transform, const double* squares,
                    double limit) {
  const Pairing pairing(all, transform);
  Agreement out;
  const std::vector<Agreeing> near = agreeing_of(pairing, squares, limit, out.share, all.count);
  const int n = all.count, m = static_cast<int>(near.size());
  out.agreeing = m;
  out.log_alarms = kNever;
  if (m == 0) return out;
  std::vector<Nearest> sums(m + 1);
  int held = 0;
  for (int j = 0; j < m; ++j) {
    sums[j + 1] = sums[j];
    sums[j + 1].add(near[j]);
    held += near[j].held;
  }
  const int sample = sample_of(m, held);
  out.redundant = m > sample;
  const double size = pairing.size();
  const bool shrunk = sums[m].square > sums[m].rows * std::pow(kShrunk * size, 2);
  const bool one_of_planes = n - sample == 1 && held < sums[m].rows;
  const int tried = std::min(m - sample, kMostDistances);
  bool sure = false;
  for (int i = 0; i < tried && !sure && !shrunk; ++i) {
    const int j = m - static_cast<int>(static_cast<std::int64_t>(i) * (m - sample) / tried);
    const double alarms =
        std::min(log_alarms(n, j, sample, near[j - 1].chance), std::log(n - sample) + sums[j].log_alarms(n));
    out.log_alarms = std::min(out.log_alarms, alarms);
    sure = alarms <= kSure || (j == n && alarms <= (sums[j].like_noise(kNoise * size) ? kLikelyNoise
                                                    : one_of_planes                   ? kLikelyPlanes
                                                                                      : kSure));
  }
  out.by_chance_alone = !sure && (out.redundant || m < n);
  if (!out.by_chance_alone) return out;
  out.by_chance = m;
  while (out.by_chance < n && log_alarms(n, out.by_chance + 1, sample, out.share) > 0) ++out.by_chance;
  return out;
}

}  // namespace sonocal
