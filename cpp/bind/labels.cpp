// Which dot of an image is of which wire.
#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/correspondences/label_fit.hpp"
#include "sonocal/correspondences/label_search.hpp"
#include "sonocal/correspondences/label_shift.hpp"
#include "sonocal/solvers/batch.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using LabelDots = In<double, nb::shape<-1, 2>>;
using LabelFirst = In<std::int32_t, nb::shape<-1>>;
using LabelLines = In<double, nb::shape<-1, -1, 2, 3>>;
using LabelStarts = In<double, nb::shape<-1, 4, 4>>;

constexpr std::int64_t kMostHypotheses = std::int64_t{1} << 40;

LabelTable label_table(const LabelDots& points, const LabelFirst& first, const LabelLines& lines) {
  const std::size_t frames = lines.shape(0), wires = lines.shape(1), count = points.shape(0);
  require(frames > 0 && count <= kMostRows && frames * wires <= kMostRows, "there is no frame, or too many");
  require(wires > 0 && wires <= kMostWires, "there are not between 1 and 255 wires");
  require(first.shape(0) == frames + 1, "first has not one number more than there are frames");
  require(first.data()[0] == 0 && first.data()[frames] == static_cast<std::int64_t>(count),
          "first does not run from 0 to the number of dots");
  for (std::size_t f = 0; f < frames; ++f) {
    const std::int64_t dots = std::int64_t{first.data()[f + 1]} - first.data()[f];
    require(dots >= 0 && dots <= kMostDots, "a frame has not between 0 and 255 dots");
  }
  check_finite(points.data(), count * 2, "points");
  check_finite(lines.data(), frames * wires * 6, "lines");
  for (std::size_t i = 0; i < frames * wires; ++i) {
    const double* at = lines.data() + 6 * i;
    require(at[0] != at[3] || at[1] != at[4] || at[2] != at[5], "a line's two points are one");
  }
  return {points.data(), first.data(), lines.data(), static_cast<int>(frames), static_cast<int>(wires)};
}

void check_reach(double reach) { require(usable(reach) && reach > 0, "reach is not a positive number"); }

void append_matrix(const Transform& a, std::vector<double>& out) {
  out.resize(out.size() + 16);
  write_row_major(a, out.data() + out.size() - 16);
}

using FoundLabels = nb::typed<nb::tuple, Out<double>, Out<double>, Out<std::int64_t>, std::int64_t, bool>;
using Settlings = nb::typed<nb::tuple, Out<double>, Out<std::int32_t>, Out<double>, Out<double>>;

FoundLabels search(LabelDots points, LabelFirst first, LabelLines lines, double reach, int finds,
                   std::int64_t hypotheses, double seconds, double least_scale, double largest_scale,
                   std::uint64_t seed) {
  const LabelTable table = label_table(points, first, lines);
  check_reach(reach);
  require(finds >= 1 && hypotheses >= 0 && hypotheses <= kMostHypotheses,
          "finds or hypotheses is out of range");
  require(usable(seconds) && seconds >= 0, "seconds is not a number from 0 on");
  require(usable(least_scale) && usable(largest_scale), "a scale is not a finite number");
  LabelSearch found;
  {
    nb::gil_scoped_release unlocked;
    const LabelScene scene(table);
    found = search_labels(scene, {reach, finds, hypotheses, seconds, least_scale, largest_scale, seed});
  }
  std::vector<double> matrices, scores;
  std::vector<std::int64_t> counts;
  for (const LabelCandidate& one : found.candidates) {
    append_matrix(one.a, matrices);
    scores.push_back(one.score);
    counts.push_back(one.finds);
  }
  const std::size_t size = scores.size();
  return nb::make_tuple(make_array(std::move(matrices), {size, 4, 4}), make_array(std::move(scores), {size}),
                        make_array(std::move(counts), {size}), found.hypotheses, found.finished);
}

Settlings settle(LabelDots points, LabelFirst first, LabelLines lines, LabelStarts starts, double reach) {
  const LabelTable table = label_table(points, first, lines);
  check_reach(reach);
  const std::size_t size = starts.shape(0), count = points.shape(0);
  check_finite(starts.data(), size * 16, "starts");
  std::vector<double> matrices, distances(size * count, kNaN), scores;
  std::vector<std::int32_t> labels(size * count, -1);
  {
    nb::gil_scoped_release unlocked;
    const LabelScene scene(table);
    std::vector<int> frames(table.frames);
    for (int f = 0; f < table.frames; ++f) frames[f] = f;
    for (std::size_t k = 0; k < size; ++k) {
      const Transform start = scene.from_original(read_row_major(starts.data() + 16 * k));
      const SettledLabels settled = settle_labels(scene, frames, start, reach / scene.size());
      append_matrix(scene.to_original(settled.a), matrices);
      scores.push_back(settled.score);
      for (const DotOnWire& pair : settled.pairs) {
        labels[k * count + pair.dot] = pair.wire;
        distances[k * count + pair.dot] = std::sqrt(pair.square) * scene.size();
      }
    }
  }
  return nb::make_tuple(
      make_array(std::move(matrices), {size, 4, 4}), make_array(std::move(labels), {size, count}),
      make_array(std::move(distances), {size, count}), make_array(std::move(scores), {size}));
}

using Shiftings = nb::typed<nb::tuple, Out<double>, Out<std::int32_t>, Out<double>, Out<double>>;

// Of each similarity and frame: the cost (K, F), the labels and what the shifts leave (K, N), the shifts (K,
// F, 3).
Shiftings shift(LabelDots points, LabelFirst first, LabelLines lines, LabelStarts starts, double reach,
                double dot, double shift) {
  const LabelTable table = label_table(points, first, lines);
  check_reach(reach);
  require(usable(dot) && dot > 0 && usable(shift) && shift > 0, "dot or shift is not a positive number");
  const std::size_t size = starts.shape(0), count = points.shape(0), frames = table.frames;
  check_finite(starts.data(), size * 16, "starts");
  std::vector<double> costs(size * frames), distances(size * count, kNaN), shifts(size * frames * 3);
  std::vector<std::int32_t> labels(size * count, -1);
  {
    nb::gil_scoped_release unlocked;
    const LabelScene scene(table);
    const FrameErrors errors{dot / scene.size(), shift / scene.size()};
    for (std::size_t k = 0; k < size; ++k) {
      const Transform a = scene.from_original(read_row_major(starts.data() + 16 * k));
      for (std::size_t f = 0; f < frames; ++f) {
        const ShiftedFrame one = shift_frame(scene, a, static_cast<int>(f), reach / scene.size(), errors);
        costs[k * frames + f] = one.cost;
        for (int axis = 0; axis < 3; ++axis)
          shifts[3 * (k * frames + f) + axis] = one.shift[axis] * scene.size();
        for (const DotOnWire& pair : one.pairs) {
          labels[k * count + pair.dot] = pair.wire;
          distances[k * count + pair.dot] = std::sqrt(pair.square) * scene.size();
        }
      }
    }
  }
  return nb::make_tuple(
      make_array(std::move(costs), {size, frames}), make_array(std::move(labels), {size, count}),
      make_array(std::move(distances), {size, count}), make_array(std::move(shifts), {size, frames, 3}));
}

}  // namespace

void bind_labels(nb::module_& m) {
  m.def("search_labels", &search, "points"_a.noconvert(), "first"_a.noconvert(), "lines"_a.noconvert(),
        "reach"_a, "finds"_a, "hypotheses"_a, "seconds"_a, "least_scale"_a, "largest_scale"_a, "seed"_a);
  m.def("settle_labels", &settle, "points"_a.noconvert(), "first"_a.noconvert(), "lines"_a.noconvert(),
        "starts"_a.noconvert(), "reach"_a);
  m.def("shift_labels", &shift, "points"_a.noconvert(), "first"_a.noconvert(), "lines"_a.noconvert(),
        "starts"_a.noconvert(), "reach"_a, "dot"_a, "shift"_a);
}
