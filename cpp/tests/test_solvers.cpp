// The core without Python, to run under sanitizers: every solver, whole and broken input, odd batch sizes.
#include <limits>

#include "check.hpp"
#include "problems.hpp"
#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/linear.hpp"
#include "sonocal/solvers/paper.hpp"
#include "sonocal/solvers/two_lines.hpp"

using namespace sonocal;

namespace {

bool near(const double* m, const Transform& truth) {
  return (read_row_major(m).matrix() - truth.matrix()).cwiseAbs().maxCoeff() < 1e-6;
}

// The truth is among the solutions of all problems but a few.
template <int kMost>
void check_batch(const Problems& p, const std::vector<double>& m, const std::vector<std::int64_t>& counts,
                 int forgiven, const char* what) {
  int missed = 0;
  for (int b = 0; b < p.size; ++b) {
    bool found = false;
    for (int k = 0; k < counts[b]; ++k) found = found || near(&m[(b * kMost + k) * 16], p.truth[b]);
    missed += !found;
    for (int i = static_cast<int>(counts[b]) * 16; i < kMost * 16; ++i)
      check(std::isnan(m[b * kMost * 16 + i]), what);
  }
  check(missed <= forgiven, what);
}

void closed_forms(int size, int threads) {
  const Problems flat = make_problems(true, size, 1), space = make_problems(false, size, 2);
  std::vector<double> m(size * 64);
  std::vector<std::int64_t> counts(size);
  four_points_batch(flat.plane_points.data(), flat.segments.data(), size, NoRealRoot::kRealPart, threads,
                    {m.data(), counts.data()});
  check_batch<4>(flat, m, counts, 1, "four_points");
  refine_batch<4>(size, threads, 8, 2, 0.0, {m.data(), counts.data()},
                  [&](std::size_t b, PointOnPlane* rows) { point_planes(flat, static_cast<int>(b), rows); });
  check_batch<4>(flat, m, counts, 1 + size / 100, "four_points, refined");
  std::vector<double> needles;
  for (int b = 0; b < size; ++b)
    for (int i = 0; i < 4; i += 2) {
      const double* s = &space.segments[(b * 4 + i) * 6];
      needles.insert(needles.end(), s, s + 6);
    }
  m.assign(size * 32, 0.0);
  two_lines_batch(space.points.data(), needles.data(), size, threads, {m.data(), counts.data()});
  check_batch<2>(space, m, counts, 1, "two_lines");
}

void general(bool planar) {
  const Problems p = make_problems(planar, 500, 3);
  int missed = 0, missed_by_paper = 0;
  for (int b = 0; b < p.size; ++b) {
    std::array<PointOnPlane, 8> rows;
    point_planes(p, b, rows.data());
    std::array<PointOnPlane, 7> seven;
    std::copy_n(rows.begin(), 7, seven.begin());
    std::array<Transform, 8> solutions;
    const auto holds = [&](int count) {
      bool found = false;
      for (int k = 0; k < count; ++k)
        found = found || (solutions[k].matrix() - p.truth[b].matrix()).cwiseAbs().maxCoeff() < 1e-5;
      return found;
    };
    missed += !holds(three_quadrics(seven, solutions, NoRealRoot::kRealPart));
    std::array<SpacePointOnLine, 4> lines;
    for (int i = 0; i < 4; ++i)
      lines[i] = {rows[2 * i].point,
                  -rows[2 * i].offset * rows[2 * i].normal - rows[2 * i + 1].offset * rows[2 * i + 1].normal,
                  cross(rows[2 * i].normal, rows[2 * i + 1].normal)};
    missed_by_paper += !holds(paper_two_lines(lines, solutions));
  }
  check(missed <= 1, "three_quadrics");
  if (!planar) check(missed_by_paper < 5, "paper_two_lines");
}

// Nothing of these may crash, write outside, or count a solution that is not finite.
void broken() {
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {0.0, nan, inf, 1e300, -1e-300}) {
    const Problems flat = make_problems(true, 9, 4);
    for (int at = 0; at < 9 * 24; at += 5) {
      std::vector<double> segments = flat.segments, m(9 * 64);
      segments[at] = bad;
      std::vector<std::int64_t> counts(9);
      four_points_batch(flat.plane_points.data(), segments.data(), 9, NoRealRoot::kRealPart, 1,
                        {m.data(), counts.data()});
      for (int b = 0; b < 9; ++b)
        for (int i = 0; i < counts[b] * 16; ++i) check(std::isfinite(m[b * 64 + i]), "broken four_points");
      std::array<PointOnPlane, 7> rows{};
      for (auto& row : rows) row = {Vector3d(bad, 1, 2), Vector3d(0, bad, 1), bad};
      std::array<Transform, 8> solutions;
      check(three_quadrics(rows, solutions, NoRealRoot::kRealPart) <= 8, "broken three_quadrics");
    }
  }
}

void linear() {
  const Problems p = make_problems(false, 1, 5);
  std::vector<double> points, planes;
  Random random(6);
  for (int i = 0; i < 40; ++i) {
    const Vector3d x = 500 * direction(random), n = direction(random);
    points.insert(points.end(), x.data(), x.data() + 3);
    planes.insert(planes.end(), n.data(), n.data() + 3);
    planes.push_back(-n.dot(p.truth[0].apply(x)));
  }
  Transform out;
  double condition;
  check(linear_similarity(points.data(), planes.data(), 40, false, out, condition), "linear");
  check((out.matrix() - p.truth[0].matrix()).cwiseAbs().maxCoeff() < 1e-8, "linear is exact");
}

}  // namespace

int main() {
  for (const int size : {0, 1, 2, 7, 8, 9, 65, 1000}) closed_forms(size, 1);
  closed_forms(1000, 3);
  general(true);
  general(false);
  broken();
  linear();
  return summary("solvers");
}
