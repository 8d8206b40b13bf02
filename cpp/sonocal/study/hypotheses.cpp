#include "sonocal/study/hypotheses.hpp"

#include <algorithm>
#include <vector>

#include "sonocal/solvers/four_points.hpp"
#include "sonocal/solvers/linear.hpp"
#include "sonocal/solvers/paper.hpp"
#include "sonocal/solvers/two_lines.hpp"

namespace sonocal {
namespace {

constexpr int kMostRows = 6;              // of a sample: two points on each of three lines
constexpr double kLeastCondition = 1e-6;  // below it the linear solution is not the only one

Line line_through(const double* ends) {
  const Eigen::Map<const Vector3d> a(ends), b(ends + 3);
  return {a, (b - a).normalized()};
}

}  // namespace

Hypotheses::Hypotheses(Solver solver, const double* points, const double* segments, const PointLines& rows,
                       const Sightings& sightings)
    : solver_(solver), points_(points), segments_(segments), rows_(rows), sightings_(sightings) {}

int Hypotheses::sample_size() const {
  const bool planar = rows_.dimension() == 2;
  if (solver_ == Solver::kLinear) return planar ? 5 : 3;
  return planar ? 4 : 2;
}

int Hypotheses::solve(const Sample& sample, std::array<Transform, kMost>& out) const {
  switch (solver_) {
    case Solver::kClosedForm:
      return closed_form(sample, out);
    case Solver::kFourPoints:
      return paper_four_points(sample, out);
    case Solver::kTwoLines:
      return paper_two_lines(sample, out);
    case Solver::kLinear:
      break;
  }
  int rows[kMostRows];
  return linear(rows, rows_of(sample, rows), out[0]) ? 1 : 0;
}

bool Hypotheses::solve_all(const PointLines::Column& squares, double limit, Transform& out) const {
  if (solver_ != Solver::kLinear) return false;
  std::vector<int> agreeing;
  for (int i = 0; i < rows_.size(); ++i)
    if (squares[i] <= limit) agreeing.push_back(i);
  const int needed = rows_.dimension() == 2 ? 5 : 6;
  return static_cast<int>(agreeing.size()) >= needed &&
         linear(agreeing.data(), static_cast<int>(agreeing.size()), out);
}

int Hypotheses::rows_of(const Sample& sample, int* rows) const {
  int count = 0;
  for (int i = 0; i < sample_size(); ++i) {
    const Sightings::Range members = sightings_[sample[i]];
    rows[count++] = members[0];
    if (rows_.dimension() == 3) rows[count++] = members[members.size() - 1];
  }
  return count;
}

int Hypotheses::closed_form(const Sample& sample, std::array<Transform, kMost>& out) const {
  int rows[kMostRows];
  rows_of(sample, rows);
  if (rows_.dimension() == 2) {
    std::array<PointOnLine, 4> problem;
    for (int i = 0; i < 4; ++i) {
      problem[i] = {rows_.point(rows[i]).head<2>(), rows_.foot(rows[i]), rows_.direction(rows[i])};
    }
    std::array<Transform, 4> solutions;
    const int count = four_points(problem, solutions, NoRealRoot::kRealPart);
    std::copy_n(solutions.begin(), count, out.begin());
    return count;
  }
  std::array<Line, 2> image, needles;
  for (int i = 0; i < 2; ++i) {
    const Vector3d first = rows_.point(rows[2 * i]), second = rows_.point(rows[2 * i + 1]);
    image[i] = {first, (second - first).normalized()};
    needles[i] = {rows_.foot(rows[2 * i]), rows_.direction(rows[2 * i])};
  }
  std::array<Transform, 2> solutions;
  const int count = two_lines(image, needles, solutions);
  std::copy_n(solutions.begin(), count, out.begin());
  return count;
}

int Hypotheses::paper_four_points(const Sample& sample, std::array<Transform, kMost>& out) const {
  std::array<PointOnLine, 4> problem;
  for (int i = 0; i < 4; ++i) {
    const int row = sightings_[sample[i]][0];
    const Line line = line_through(segments_ + 6 * row);
    problem[i] = {image(row).head<2>(), line.point, line.direction};
  }
  std::array<Transform, 4> solutions;
  const int count = sonocal::paper_four_points(problem, solutions, NoRealRoot::kRealPart);
  for (int k = 0; k < count; ++k) out[k] = rows_.normalisation().to_normalised(solutions[k]);
  return count;
}

int Hypotheses::paper_two_lines(const Sample& sample, std::array<Transform, kMost>& out) const {
  // At k = 0 the paper's matrix C is singular; k of the image's size is well away from that.
  const double k = rows_.dimension() == 2 ? rows_.normalisation().image_size : 0;
  int rows[kMostRows];
  rows_of(sample, rows);
  std::array<SpacePointOnLine, 4> problem;
  for (int i = 0; i < 4; ++i) {
    const Line line = line_through(segments_ + 6 * rows[i]);
    problem[i] = {image(rows[i]) + k * Vector3d::UnitZ(), line.point, line.direction};
  }
  const int count = sonocal::paper_two_lines(problem, out, NoRealRoot::kRealPart);
  for (int i = 0; i < count; ++i) {
    out[i].translation += k * out[i].linear().col(2);
    out[i] = rows_.normalisation().to_normalised(out[i]);
  }
  return count;
}

bool Hypotheses::linear(const int* rows, int count, Transform& out) const {
  std::vector<double> points, planes;
  points.reserve(6 * count);
  planes.reserve(8 * count);
  for (int i = 0; i < count; ++i) {
    const Line line = line_through(segments_ + 6 * rows[i]);
    Vector3d normal[2];
    perpendicular_basis(line.direction, normal[0], normal[1]);
    for (const Vector3d& n : normal) {
      points.insert(points.end(), points_ + 3 * rows[i], points_ + 3 * rows[i] + 3);
      planes.insert(planes.end(), {n.x(), n.y(), n.z(), -n.dot(line.point)});
    }
  }
  double condition;
  if (!linear_similarity(points.data(), planes.data(), 2 * count, rows_.dimension() == 2, out, condition) ||
      !(condition > kLeastCondition))
    return false;
  out = rows_.normalisation().to_normalised(out);
  return true;
}

}  // namespace sonocal
