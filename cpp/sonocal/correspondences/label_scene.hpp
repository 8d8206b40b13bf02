// Dots of images and the lines that some of them are of, nobody knows which.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "sonocal/linalg/transform.hpp"

namespace sonocal {

struct LabelTable {
  const double* points;       // N x 2, px
  const std::int32_t* first;  // frames + 1: frame f has the dots first[f] up to first[f + 1]
  const double* lines;        // frames x wires x 2 x 3, mm: two points on each
  int frames, wires;
};

// As many fit into the arrays that a frame is matched in.
constexpr int kMostDots = 255, kMostWires = 255;

// One dot and the wire that is taken for its own.
struct DotOnWire {
  int dot, wire;  // the dot's number in the table
  double square;  // of their distance
};

// The table about its own centres: image coordinates and lengths of order one.
class LabelScene {
 public:
  explicit LabelScene(const LabelTable& table);

  int frames() const { return table_.frames; }
  int wires() const { return table_.wires; }
  int dots() const { return table_.first[table_.frames]; }
  int first(int frame) const { return table_.first[frame]; }
  int dots(int frame) const { return table_.first[frame + 1] - table_.first[frame]; }
  Vector2d dot(int dot) const { return dots_[dot]; }
  Vector3d foot(int frame, int wire) const { return feet_[at(frame, wire)]; }
  Vector3d direction(int frame, int wire) const { return directions_[at(frame, wire)]; }
  double square(const Transform& a, int frame, int dot, int wire) const;

  double size() const { return size_; }  // of the lines, mm
  // Of the box that holds all dots, divided by how many a frame has: what chance alone has to meet.
  double area_of_dot() const { return area_of_dot_; }
  Vector2d low() const { return low_; }
  Vector2d high() const { return high_; }
  // The farthest that two similarities take a corner of the box that holds all dots apart.
  double apart(const Transform& a, const Transform& b) const;

  Transform to_original(const Transform& a) const;
  Transform from_original(const Transform& a) const;

 private:
  int at(int frame, int wire) const { return frame * table_.wires + wire; }
  void normalise_dots();
  void normalise_lines();

  LabelTable table_;
  std::vector<Vector2d> dots_;
  std::vector<Vector3d> feet_, directions_;
  Vector2d image_centre_ = Vector2d::Zero(), low_ = Vector2d::Zero(), high_ = Vector2d::Zero();
  Vector3d centre_ = Vector3d::Zero();
  double image_size_ = 1, size_ = 1, area_of_dot_ = 1;
};

}  // namespace sonocal
