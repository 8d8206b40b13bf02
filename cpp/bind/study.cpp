// Batches of independent trials of one shape: arrays in, matrices out, the lock released around the loop.
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <string>
#include <tuple>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/solvers/batch.hpp"
#include "sonocal/study/trial.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using Points = In<double, nb::shape<-1, -1, 3>>;
using Segments = In<double, nb::shape<-1, -1, 2, 3>>;

// Trials of the same number of rows; of a 3D probe, two rows in turn are one sighting.
class Trials {
 public:
  Trials(const Points& points, const Segments& segments, int dimension)
      : points_(points.data()),
        segments_(segments.data()),
        size_(points.shape(0)),
        rows_(points.shape(1)),
        dimension_(dimension) {
    if (segments.shape(0) != size_ || segments.shape(1) != rows_ || (dimension != 2 && dimension != 3))
      throw nb::value_error("the arrays differ in their number of trials or rows");
    require(rows_ > 0 && rows_ <= kMostRows, "a trial has between one row and 2^28");
    check_finite(points_, size_ * rows_ * 3, "points");
    check_finite(segments_, size_ * rows_ * 6, "segments");
    for (std::size_t i = 0; dimension == 3 && i < rows_; ++i)
      sightings_.push_back(static_cast<std::int32_t>(i / 2));
  }
  std::size_t size() const { return size_; }
  std::size_t rows() const { return rows_; }
  Table operator[](std::size_t i) const {
    return {points_ + i * rows_ * 3,
            segments_ + i * rows_ * 6,
            sightings_.empty() ? nullptr : sightings_.data(),
            {},
            {},
            static_cast<int>(rows_),
            dimension_};
  }

 private:
  const double *points_, *segments_;
  std::size_t size_, rows_;
  int dimension_;
  std::vector<std::int32_t> sightings_;
};

void check_numbers(double level_px, double level_mm, int threads) {
  require(usable(level_px) && level_px >= 0 && usable(level_mm) && level_mm >= 0,
          "a noise level is not a number from 0 on");
  check_threads(threads);
}

Solver solver_named(const std::string& name) {
  if (name == "closed_form") return Solver::kClosedForm;
  if (name == "paper_four_points") return Solver::kFourPoints;
  if (name == "paper_two_lines") return Solver::kTwoLines;
  if (name == "linear") return Solver::kLinear;
  refuse("no such solver: " + name);
}

void write(const std::optional<Transform>& transform, double* out) {
  if (transform && transform->matrix().allFinite())
    write_row_major(*transform, out);
  else
    std::fill_n(out, 16, kNaN);
}

std::tuple<Out<double>, Out<double>> run(Points points, Segments segments,
                                         In<std::uint64_t, nb::ndim<1>> seeds, int dimension,
                                         const std::string& solver, bool likelihood, double threshold_mm,
                                         double level_px, double level_mm, double confidence, int max_samples,
                                         int threads) {
  const Trials trials(points, segments, dimension);
  if (seeds.shape(0) != trials.size()) throw nb::value_error("one seed a trial");
  const Method method{solver_named(solver), likelihood ? Weighting::kLikelihood : Weighting::kGeometric};
  require(method.solver != Solver::kFourPoints || dimension == 2, "four points are of a 2D image");
  check_numbers(level_px, level_mm, threads);
  require(threshold_mm >= 0, "threshold_mm is not a number from 0 on");
  require(confidence > 0 && confidence < 1, "confidence is not between 0 and 1");
  require(max_samples > 0 && max_samples <= kMostSamples, "max_samples is not between 1 and 2^30");
  Options common;
  common.threshold_mm = threshold_mm;
  common.levels = {level_px, level_mm};
  common.consensus.confidence = confidence;
  common.consensus.max_samples = max_samples;
  std::vector<double> starts(trials.size() * 16), refined(trials.size() * 16);
  {
    nb::gil_scoped_release unlocked;
    in_threads(trials.size(), threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        Options options = common;
        options.consensus.seed = seeds.data()[i];
        const TrialAnswer answer = run_trial(trials[i], method, options);
        write(answer.start, starts.data() + 16 * i);
        write(answer.refined, refined.data() + 16 * i);
      }
    });
  }
  return {make_array(std::move(starts), {trials.size(), 4, 4}),
          make_array(std::move(refined), {trials.size(), 4, 4})};
}

Out<double> bounds(Points points, Segments segments, In<bool, nb::ndim<2>> sound,
                   In<double, nb::shape<-1, 4, 4>> truth, int dimension, double level_px, double level_mm,
                   int threads) {
  const Trials trials(points, segments, dimension);
  if (sound.shape(0) != trials.size() || sound.shape(1) != trials.rows() || truth.shape(0) != trials.size())
    throw nb::value_error("the arrays differ in their number of trials or rows");
  check_numbers(level_px, level_mm, threads);
  check_finite(truth.data(), truth.shape(0) * 16, "truth");
  Options options;
  options.levels = {level_px, level_mm};
  std::vector<double> out(trials.size() * 49);
  {
    nb::gil_scoped_release unlocked;
    in_threads(trials.size(), threads, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i)
        Eigen::Map<Eigen::Matrix<double, 7, 7>>(out.data() + 49 * i) = cramer_rao_bound(
            trials[i], sound.data() + i * trials.rows(), read_row_major(truth.data() + 16 * i), options);
    });
  }
  return make_array(std::move(out), {trials.size(), 7, 7});
}

}  // namespace

void bind_study(nb::module_& m) {
  m.def("study_trials", &run, "points"_a.noconvert(), "segments"_a.noconvert(), "seeds"_a.noconvert(),
        nb::kw_only(), "dimension"_a, "solver"_a, "likelihood"_a, "threshold_mm"_a, "level_px"_a,
        "level_mm"_a, "confidence"_a, "max_samples"_a, "threads"_a);
  m.def("study_bounds", &bounds, "points"_a.noconvert(), "segments"_a.noconvert(), "sound"_a.noconvert(),
        "truth"_a.noconvert(), nb::kw_only(), "dimension"_a, "level_px"_a, "level_mm"_a, "threads"_a);
}
