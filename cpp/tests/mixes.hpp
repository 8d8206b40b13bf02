// Tables of correspondences of several kinds with their truth, for the tests of mixes.
#pragma once

#include "problems.hpp"
#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/solvers/gauss_newton.hpp"

namespace sonocal {

// Points on planes, on lines and on points, lines on lines, planes on planes: `each` of every kind, the first
// `wrong` of each having targets elsewhere.
struct Mix {
  static constexpr int kKinds = 5;
  std::vector<double> points, planes;
  std::vector<std::int32_t> first{0};
  std::vector<bool> sound;
  Transform truth;

  Mix(int each, int wrong, std::uint64_t seed, double noise = 0) : noise_(noise), random_(seed) {
    truth = make_problems(false, 1, seed).truth[0];
    for (int kind = 0; kind < kKinds; ++kind)
      for (int i = 0; i < each; ++i) {
        sound.push_back(i >= wrong);
        add(kind, i < wrong);
      }
  }
  Correspondences table() const {
    return {points.data(), planes.data(), first.data(), static_cast<int>(sound.size())};
  }

 private:
  Vector3d place() { return {uniform(random_, 0, 500), uniform(random_, 0, 500), uniform(random_, 0, 500)}; }

  void add(int kind, bool wrong) {
    const Vector3d x = place(), other = place();
    const Vector3d off = wrong ? Vector3d(60 * direction(random_)) : Vector3d(noise_ * direction(random_));
    const Vector3d y = truth.apply(x) + off, z = truth.apply(other) + off;
    PointOnPlane rows[4];
    int count = 1;
    if (kind == 0) {
      const Vector3d normal = direction(random_);
      rows[0] = {x, normal, -normal.dot(y)};
    } else if (kind == 1 || kind == 3) {
      const Vector3d along = kind == 3 ? Vector3d((z - y).normalized()) : direction(random_);
      planes_of_line(x, y, along, rows);
      planes_of_line(other, y, along, rows + 2);
      count = kind == 3 ? 4 : 2;
    } else if (kind == 2) {
      count = 3;
      for (int axis = 0; axis < 3; ++axis) rows[axis] = {x, Vector3d::Unit(axis), -y[axis]};
    } else {
      count = 3;
      const Vector3d third = place();
      const Vector3d normal = cross(z - y, truth.apply(third) + off - y).normalized();
      const Vector3d sources[3] = {x, other, third};
      for (int i = 0; i < 3; ++i) rows[i] = {sources[i], normal, -normal.dot(y)};
    }
    for (int i = 0; i < count; ++i) put(rows[i]);
    first.push_back(first.back() + count);
  }
  void put(const PointOnPlane& row) {
    points.insert(points.end(), row.point.data(), row.point.data() + 3);
    planes.insert(planes.end(), row.normal.data(), row.normal.data() + 3);
    planes.push_back(row.offset);
  }

  double noise_;
  Random random_;
};

}  // namespace sonocal
