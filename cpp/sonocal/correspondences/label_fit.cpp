#include "sonocal/correspondences/label_fit.hpp"

#include <algorithm>
#include <bitset>

#include "sonocal/correspondences/descent.hpp"
#include "sonocal/solvers/normal_equations.hpp"

namespace sonocal {
namespace {

constexpr int kLabelRounds = 6, kSteps = 5;
// As many as hold the seven motions, and one to spare.
constexpr std::size_t kLeastPairs = 5;

void choose(const LabelScene& scene, const std::vector<int>& frames, const Transform& a, double reach,
            std::vector<DotOnWire>& out) {
  out.clear();
  for (int f : frames) pairs_within(scene, a, f, reach, out);
}

bool same(const std::vector<DotOnWire>& a, const std::vector<DotOnWire>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const DotOnWire& x, const DotOnWire& y) {
    return x.dot == y.dot && x.wire == y.wire;
  });
}

}  // namespace

void fit_pairs(const LabelScene& scene, const std::vector<DotOnWire>& pairs, int steps, Transform& a) {
  NormalEquations cost(2);
  Block block;
  int frame = 0;
  for (const DotOnWire& pair : pairs) {
    while (frame > 0 && scene.first(frame) > pair.dot) --frame;
    while (scene.first(frame) + scene.dots(frame) <= pair.dot) ++frame;
    const int i = block.count++;
    const Vector3d foot = scene.foot(frame, pair.wire);
    Vector3d normals[2];
    perpendicular_basis(scene.direction(frame, pair.wire), normals[0], normals[1]);
    block.x[0][i] = scene.dot(pair.dot).x();
    block.x[1][i] = scene.dot(pair.dot).y();
    block.x[2][i] = 0;
    block.h[i] = 1;
    for (int plane = 0; plane < 2; ++plane) {
      for (int axis = 0; axis < 3; ++axis) block.normal[plane][axis][i] = normals[plane][axis];
      block.offset[plane][i] = -normals[plane].dot(foot);
      block.weight[plane][i] = 1;
    }
    if (block.count < Block::kRows) continue;
    cost.add(block);
    block.count = 0;
  }
  if (block.count > 0) cost.add(block);
  descend(cost, steps, false, a);
}

void pairs_within(const LabelScene& scene, const Transform& a, int frame, double reach,
                  std::vector<DotOnWire>& out) {
  const std::size_t begin = out.size();
  const int first = scene.first(frame), dots = scene.dots(frame);
  for (int i = 0; i < dots; ++i)
    for (int w = 0; w < scene.wires(); ++w) {
      const double square = scene.square(a, frame, first + i, w);
      if (square < reach * reach) out.push_back({first + i, w, square});
    }
  std::sort(out.begin() + begin, out.end(), [](const DotOnWire& x, const DotOnWire& y) {
    if (x.square != y.square) return x.square < y.square;
    return x.dot != y.dot ? x.dot < y.dot : x.wire < y.wire;
  });
  std::bitset<kMostDots> dot_taken;
  std::bitset<kMostWires> wire_taken;
  std::size_t end = begin;
  for (std::size_t i = begin; i < out.size(); ++i) {
    const DotOnWire pair = out[i];
    if (dot_taken[pair.dot - first] || wire_taken[pair.wire]) continue;
    dot_taken[pair.dot - first] = wire_taken[pair.wire] = true;
    out[end++] = pair;
  }
  out.resize(end);
}

SettledLabels settle_labels(const LabelScene& scene, const std::vector<int>& frames, const Transform& start,
                            double reach) {
  SettledLabels out;
  out.a = start;
  std::vector<DotOnWire> before;
  for (const double within : {2 * reach, reach}) {
    before.clear();
    for (int round = 0; round < kLabelRounds; ++round) {
      choose(scene, frames, out.a, within, out.pairs);
      if (out.pairs.size() < kLeastPairs || (round > 0 && same(before, out.pairs))) break;
      fit_pairs(scene, out.pairs, kSteps, out.a);
      before = out.pairs;
    }
  }
  choose(scene, frames, out.a, reach, out.pairs);
  for (const DotOnWire& pair : out.pairs) out.score += 1 - pair.square / (reach * reach);
  return out;
}

}  // namespace sonocal
