#include "sonocal/correspondences/label_scene.hpp"

#include <algorithm>
#include <cmath>

#include "sonocal/linalg/small.hpp"

namespace sonocal {

LabelScene::LabelScene(const LabelTable& table) : table_(table) {
  normalise_dots();
  normalise_lines();
}

void LabelScene::normalise_dots() {
  const int count = dots();
  const Eigen::Map<const Eigen::Matrix<double, 2, Eigen::Dynamic>> all(table_.points, 2, count);
  if (count > 0) {
    low_ = all.rowwise().minCoeff();
    high_ = all.rowwise().maxCoeff();
    image_centre_ = 0.5 * (low_ + high_);
    image_size_ = 0.5 * (high_ - low_).norm();
    if (!(image_size_ > 0)) image_size_ = 1;
  }
  dots_.resize(count);
  for (int i = 0; i < count; ++i) dots_[i] = (all.col(i) - image_centre_) / image_size_;
  low_ = (low_ - image_centre_) / image_size_;
  high_ = (high_ - image_centre_) / image_size_;
  const Vector2d sides = high_ - low_;
  area_of_dot_ = std::max(sides.x() * sides.y(), 1e-6) * table_.frames / std::max(count, 1);
}

// The centre is the point nearest to all lines; their size is how far they are from it.
void LabelScene::normalise_lines() {
  const int count = table_.frames * table_.wires;
  const Eigen::Map<const Eigen::Matrix<double, 6, Eigen::Dynamic>> ends(table_.lines, 6, count);
  Vector3d middle = Vector3d::Zero();
  for (int i = 0; i < count; ++i) middle += 0.5 * (ends.col(i).head<3>() + ends.col(i).tail<3>()) / count;
  SmallMatrix across = SmallMatrix::Zero(3, 3);
  SmallVector pull = SmallVector::Zero(3);
  feet_.resize(count);
  directions_.resize(count);
  for (int i = 0; i < count; ++i) {
    directions_[i] = (ends.col(i).tail<3>() - ends.col(i).head<3>()).normalized();
    const Vector3d from = ends.col(i).head<3>() - middle;
    feet_[i] = from - directions_[i].dot(from) * directions_[i];
    for (int row = 0; row < 3; ++row) {
      pull[row] += feet_[i][row];
      for (int col = 0; col < 3; ++col)
        across(row, col) += (row == col) - directions_[i][row] * directions_[i][col];
    }
  }
  // Parallel lines leave the way along them free; there the middle stays.
  for (int k = 0; k < 3; ++k) across(k, k) += 1e-3 * count;
  const SmallVector moved = least_squares(across, pull);
  centre_ = middle + Vector3d(moved[0], moved[1], moved[2]);
  double squares = 0;
  for (int i = 0; i < count; ++i) {
    const Vector3d from = ends.col(i).head<3>() - centre_;
    feet_[i] = from - directions_[i].dot(from) * directions_[i];
    squares += feet_[i].squaredNorm() / count;
  }
  size_ = std::sqrt(squares);
  if (!(size_ > 0)) size_ = 1;
  for (Vector3d& foot : feet_) foot /= size_;
}

double LabelScene::square(const Transform& a, int frame, int dot, int wire) const {
  const Vector2d& x = dots_[dot];
  const Vector3d from = a.scales[0] * (x.x() * a.rotation.col(0) + x.y() * a.rotation.col(1)) +
                        a.translation - foot(frame, wire);
  const double along = from.dot(direction(frame, wire));
  return std::max(from.squaredNorm() - along * along, 0.0);
}

double LabelScene::apart(const Transform& a, const Transform& b) const {
  double most = 0;
  for (double u : {low_.x(), high_.x()})
    for (double v : {low_.y(), high_.y()})
      most = std::max(most, (a.apply({u, v, 0}) - b.apply({u, v, 0})).norm());
  return most;
}

Transform LabelScene::to_original(const Transform& a) const {
  Transform out = a;
  out.scales = a.scales * (size_ / image_size_);
  out.translation =
      centre_ + size_ * a.translation - out.linear() * Vector3d(image_centre_.x(), image_centre_.y(), 0);
  return out;
}

Transform LabelScene::from_original(const Transform& a) const {
  Transform out = a;
  out.scales = a.scales * (image_size_ / size_);
  out.translation = (a.apply({image_centre_.x(), image_centre_.y(), 0}) - centre_) / size_;
  return out;
}

}  // namespace sonocal
