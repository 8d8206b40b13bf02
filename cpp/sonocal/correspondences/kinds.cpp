#include "sonocal/correspondences/kinds.hpp"

#include <algorithm>
#include <map>

#include "sonocal/robust/random.hpp"

namespace sonocal {
namespace {

constexpr double kRightAngle = 1e-9;
// Of the shuffle, which decides what a scorer sees first and nothing else.
constexpr std::uint64_t kSeed = 1;

struct Pattern {
  std::vector<bool> same_point;
  bool line, plane, point;

  bool operator<(const Pattern& other) const {
    if (same_point.size() != other.same_point.size()) return same_point.size() > other.same_point.size();
    if (same_point != other.same_point) return same_point < other.same_point;
    if (line != other.line) return line;
    return plane != other.plane ? plane : point && !other.point;
  }
};

bool at_right_angles(const double* a, const double* b) {
  return std::fabs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) < kRightAngle;
}

Pattern pattern_of(const Correspondences& all, int c) {
  const int begin = all.first[c], rows = all.first[c + 1] - begin;
  const double *points = all.points + 3 * begin, *planes = all.planes + 4 * begin;
  const auto plane_equal = [&](int i, int j) {
    return std::equal(planes + 4 * i, planes + 4 * i + 4, planes + 4 * j);
  };
  Pattern out{std::vector<bool>(rows), false, rows > 1, false};
  for (int i = 1; i < rows; ++i) {
    out.same_point[i] = std::equal(points + 3 * i, points + 3 * i + 3, points + 3 * (i - 1));
    out.plane = out.plane && !out.same_point[i] && plane_equal(i, 0);
  }
  out.line = out.same_point == std::vector<bool>{false, true, false, true} && plane_equal(0, 2) &&
             plane_equal(1, 3) && at_right_angles(planes, planes + 4);
  out.point = out.same_point == std::vector<bool>{false, true, true} && at_right_angles(planes, planes + 4) &&
              at_right_angles(planes, planes + 8) && at_right_angles(planes + 4, planes + 8);
  return out;
}

void shuffle(std::vector<int>& units, Random& random) {
  for (int i = static_cast<int>(units.size()) - 1; i > 0; --i)
    std::swap(units[i], units[random.below(i + 1)]);
}

}  // namespace

int UnitKind::points() const {
  return static_cast<int>(std::count(same_point.begin(), same_point.end(), false));
}

std::vector<UnitKind> kinds_of(const Correspondences& all) {
  std::map<Pattern, std::vector<int>> units;
  for (int c = 0; c < all.count; ++c) units[pattern_of(all, c)].push_back(c);
  std::vector<UnitKind> out;
  Random random(kSeed);
  for (auto& [pattern, members] : units) {
    shuffle(members, random);
    out.push_back({pattern.same_point, pattern.line, pattern.plane, pattern.point, std::move(members)});
  }
  return out;
}

}  // namespace sonocal
