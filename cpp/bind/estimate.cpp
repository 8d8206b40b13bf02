// The whole estimate in one call, refinement alone, whitened residuals, correspondences of any kind: a table
// and options in, one kind of result out.
#include "sonocal/estimate/estimate.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <optional>
#include <string>

#include "bind/chosen.hpp"
#include "bind/table.hpp"
#include "bind/white.hpp"
#include "sonocal/correspondences/chance.hpp"
#include "sonocal/estimate/lines_agreement.hpp"
#include "sonocal/estimate/mixed_estimate.hpp"
#include "sonocal/estimate/white_residuals.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

// More combinations than could be gone through.
constexpr int kMostCombinations = 1 << 20;
constexpr double kRotationTolerance = 1e-6;

Model model_named(const std::string& name) {
  if (name == "similarity") return Model::kSimilarity;
  if (name == "anisotropic") return Model::kAnisotropic;
  if (name == "rigid") return Model::kScaleKnown;
  refuse("no such model: " + name);
}

Weighting weighting_named(const std::string& name) {
  if (name == "geometric") return Weighting::kGeometric;
  if (name == "likelihood") return Weighting::kLikelihood;
  refuse("no such weighting: " + name);
}

Options options_of(const std::string& model, const std::string& weighting, double threshold, double level_px,
                   double level_mm, double confidence, int max_samples, int exhaustive_samples,
                   std::uint64_t seed, double scale) {
  check_scale(scale);
  require((scale > 0) == (model == "rigid"), "the rigid model, and no other, has a known scale");
  require(threshold >= 0, "threshold is not a number from 0 on");
  require(usable(level_px) && level_px >= 0 && usable(level_mm) && level_mm >= 0,
          "a noise level is not a number from 0 on");
  require(confidence > 0 && confidence < 1, "confidence is not between 0 and 1");
  require(max_samples > 0 && max_samples <= kMostSamples, "max_samples is not between 1 and 2^30");
  require(exhaustive_samples >= 0 && exhaustive_samples <= kMostCombinations,
          "exhaustive_samples is not between 0 and 2^20");
  return {model_named(model),
          weighting_named(weighting),
          threshold,
          {level_px, level_mm},
          {confidence, max_samples, exhaustive_samples, seed},
          scale};
}

using Rotation = In<double, nb::shape<3, 3>>;
using Vector = In<double, nb::shape<3>>;

Transform transform_of(const Rotation& rotation, const Vector& translation, const Vector& scales) {
  check_finite(rotation.data(), 9, "rotation");
  check_finite(translation.data(), 3, "translation");
  check_finite(scales.data(), 3, "scales");
  using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  const Transform a{Eigen::Map<const RowMajor3>(rotation.data()),
                    Eigen::Map<const Vector3d>(translation.data()),
                    Eigen::Map<const Vector3d>(scales.data())};
  const Matrix3d off = a.rotation * a.rotation.transpose() - Matrix3d::Identity();
  require(off.cwiseAbs().maxCoeff() <= kRotationTolerance, "rotation is not orthonormal");
  require(a.scales.minCoeff() > 0, "scales are not positive");
  return a;
}

// What any of the calls below finds; asking for what a call does not make is an AttributeError.
struct PyEstimate {
  using Array = std::optional<Out<double>>;
  bool found = false, converged = false;
  bool sound = false;  // the transform is one: finite numbers, scales above 0
  bool plain = false;  // so many rows agree that chance need not be counted
  int inliers = 0, samples = 0;
  double threshold = 0, squared_sum = 0, level_px = 0, level_mm = 0, least_information = 0, freedom = 0;
  Out<double> rotation, translation, scales;
  Array residuals_mm, covariance;
  Array jacobian, shift, by_level, white;
  std::optional<Out<std::int32_t>> row;
};

template <auto kMember>
auto made(const PyEstimate& e) {
  if (!(e.*kMember)) throw nb::attribute_error("this call makes no such array");
  return *(e.*kMember);
}

void put(const Transform& transform, PyEstimate& result) {
  result.sound = transform.rotation.allFinite() && transform.translation.allFinite() &&
                 transform.scales.allFinite() && transform.scales.minCoeff() > 0;
  result.rotation = to_numpy(transform.rotation);
  result.translation = to_numpy(transform.translation);
  result.scales = to_numpy(transform.scales);
}

PyEstimate to_python(const Estimate& e) {
  PyEstimate result;
  result.found = e.found;
  result.converged = e.converged;
  result.inliers = e.inliers;
  result.samples = e.samples;
  result.threshold = e.threshold_mm;
  result.squared_sum = e.squared_sum;
  result.level_px = e.levels.px;
  result.level_mm = e.levels.mm;
  result.least_information = e.least_information;
  put(e.transform, result);
  result.residuals_mm = to_numpy(PointLines::Column(e.squares.sqrt()).matrix());
  result.covariance = to_numpy(e.covariance);
  return result;
}

PyEstimate py_estimate(const BoundTable& bound, const Options& asked) {
  const Table table = bound.lines();
  const Options options = options_for(table.dimension, asked);
  Estimate result;
  bool plain = false;
  {
    nb::gil_scoped_release unlocked;
    result = estimate(table, options);
    const double limit = result.threshold_mm * result.threshold_mm;
    plain = result.found && plainly_more(table, result.transform, result.squares.data(), limit);
  }
  PyEstimate out = to_python(result);
  out.plain = plain;
  return out;
}

PyEstimate py_refine(const BoundTable& bound, const Chosen& chosen, const Transform& start,
                     const Options& asked) {
  const Table table = bound.lines();
  const Options options = options_for(table.dimension, asked);
  const bool* rows = checked_rows(chosen, table);
  Estimate result;
  {
    nb::gil_scoped_release unlocked;
    result = refine_chosen(table, rows, start, options);
  }
  return to_python(result);
}

PyEstimate py_white_residuals(const BoundTable& bound, const Chosen& chosen, const Transform& at,
                              const Options& asked) {
  WhiteResiduals white = white_of(bound, chosen, at, asked);
  PyEstimate result;
  result.found = result.converged = true;
  result.inliers = static_cast<int>(white.residual.size() / 2);
  result.level_px = asked.levels.px;
  result.level_mm = asked.levels.mm;
  put(at, result);
  result.jacobian = to_numpy(white.jacobian);
  result.shift = to_numpy(white.shift);
  result.by_level = to_numpy(white.by_level);
  result.white = to_numpy(white.residual);
  const std::size_t count = white.row.size();
  result.row = make_array(std::move(white.row), {count});
  return result;
}

PyEstimate py_estimate_correspondences(const BoundTable& bound, const Options& options, bool refine,
                                       const std::optional<Residuals>& weights) {
  const Correspondences all = bound.planes();
  const double* factors = checked_weights(weights, all.count);
  CorrespondenceEstimate e;
  {
    nb::gil_scoped_release unlocked;
    ConsensusOptions consensus = options.consensus;
    consensus.exhaustive_samples = 0;
    e = estimate(all, {options.threshold_mm, refine, options.scale, factors, consensus});
  }
  PyEstimate result;
  result.found = e.found;
  result.converged = e.converged;
  result.inliers = e.inliers;
  result.samples = e.samples;
  result.threshold = options.threshold_mm;
  put(e.transform, result);
  const Eigen::Map<const Eigen::VectorXd> squares(e.squares.data(),
                                                  static_cast<Eigen::Index>(e.squares.size()));
  result.residuals_mm = to_numpy(squares.cwiseSqrt());
  return result;
}

PyEstimate py_maximise(const BoundTable& bound, const Transform& start, const Options& asked) {
  const MixedTable table = bound.targets();
  const Options options = options_for(table.dimension, asked);
  MixedEstimate e;
  {
    nb::gil_scoped_release unlocked;
    e = maximise_mixed(table, start, options.model, options.levels, options.threshold_mm);
  }
  PyEstimate result;
  result.found = e.inliers > 0;
  result.converged = e.converged;
  result.inliers = e.inliers;
  result.threshold = options.threshold_mm;
  result.level_px = e.levels.px;
  result.level_mm = e.levels.mm;
  result.freedom = e.freedom;
  put(e.transform, result);
  result.covariance = to_numpy(e.covariance);
  const Eigen::Map<const Eigen::VectorXd> squares(e.squares.data(),
                                                  static_cast<Eigen::Index>(e.squares.size()));
  result.residuals_mm = to_numpy(squares.cwiseSqrt());
  return result;
}

std::vector<double> squares_of(const Residuals& residuals, int count) {
  require(residuals.shape(0) == static_cast<std::size_t>(count), "residuals are not one a correspondence");
  std::vector<double> squares(residuals.data(), residuals.data() + count);
  for (double& square : squares) square *= square;
  return squares;
}

Agreement py_agreement(const BoundTable& bound, const Transform& at, const Residuals& residuals,
                       double threshold) {
  require(threshold >= 0, "threshold is not a number from 0 on");
  const double limit = threshold * threshold;
  if (bound.of_points_and_lines()) {
    const Table table = bound.lines();
    const std::vector<double> squares = squares_of(residuals, sightings_of(table).size());
    nb::gil_scoped_release unlocked;
    return agreement(table, at, squares.data(), limit);
  }
  const Correspondences all = bound.planes();
  const std::vector<double> squares = squares_of(residuals, all.count);
  nb::gil_scoped_release unlocked;
  return agreement(all, at, squares.data(), limit);
}

}  // namespace

void bind_estimate(nb::module_& m) {
  const auto owned = nb::rv_policy::automatic;
  nb::class_<Options>(m, "Options")
      .def(
          "__init__",
          [](Options* self, const std::string& model, const std::string& weighting, double threshold,
             double level_px, double level_mm, double confidence, int max_samples, int exhaustive_samples,
             std::uint64_t seed, double scale) {
            new (self) Options(options_of(model, weighting, threshold, level_px, level_mm, confidence,
                                          max_samples, exhaustive_samples, seed, scale));
          },
          nb::kw_only(), "model"_a, "weighting"_a, "threshold"_a, "level_px"_a, "level_mm"_a, "confidence"_a,
          "max_samples"_a, "exhaustive_samples"_a, "seed"_a, "scale"_a = 0.0);
  nb::class_<Transform>(m, "Transform")
      .def(
          "__init__",
          [](Transform* self, const Rotation& rotation, const Vector& translation, const Vector& scales) {
            new (self) Transform(transform_of(rotation, translation, scales));
          },
          "rotation"_a.noconvert(), "translation"_a.noconvert(), "scales"_a.noconvert());
  nb::class_<PyEstimate>(m, "Estimate")
      .def_ro("found", &PyEstimate::found)
      .def_ro("converged", &PyEstimate::converged)
      .def_ro("sound", &PyEstimate::sound)
      .def_ro("plain", &PyEstimate::plain)
      .def_ro("inliers", &PyEstimate::inliers)
      .def_ro("samples", &PyEstimate::samples)
      .def_ro("threshold", &PyEstimate::threshold)
      .def_ro("squared_sum", &PyEstimate::squared_sum)
      .def_ro("level_px", &PyEstimate::level_px)
      .def_ro("level_mm", &PyEstimate::level_mm)
      .def_ro("least_information", &PyEstimate::least_information)
      .def_ro("freedom", &PyEstimate::freedom)
      .def_ro("rotation", &PyEstimate::rotation, owned)
      .def_ro("translation", &PyEstimate::translation, owned)
      .def_ro("scales", &PyEstimate::scales, owned)
      .def_prop_ro("residuals_mm", &made<&PyEstimate::residuals_mm>, owned)
      .def_prop_ro("covariance", &made<&PyEstimate::covariance>, owned)
      .def_prop_ro("jacobian", &made<&PyEstimate::jacobian>, owned)
      .def_prop_ro("shift", &made<&PyEstimate::shift>, owned)
      .def_prop_ro("by_level", &made<&PyEstimate::by_level>, owned)
      .def_prop_ro("white", &made<&PyEstimate::white>, owned)
      .def_prop_ro("row", &made<&PyEstimate::row>, owned);
  m.def("estimate", &py_estimate, "table"_a, "options"_a);
  m.def("refine", &py_refine, "table"_a, "chosen"_a.noconvert(), "start"_a, "options"_a);
  m.def("white_residuals", &py_white_residuals, "table"_a, "chosen"_a.noconvert(), "at"_a, "options"_a);
  m.def("estimate_correspondences", &py_estimate_correspondences, "table"_a, "options"_a, nb::kw_only(),
        "refine"_a = true, "weights"_a.noconvert() = nb::none());
  m.def("maximise", &py_maximise, "table"_a, "start"_a, "options"_a);
  nb::class_<Agreement>(m, "Agreement")
      .def_ro("agreeing", &Agreement::agreeing)
      .def_ro("by_chance", &Agreement::by_chance)
      .def_ro("share", &Agreement::share)
      .def_ro("log_alarms", &Agreement::log_alarms)
      .def_ro("redundant", &Agreement::redundant)
      .def_ro("by_chance_alone", &Agreement::by_chance_alone);
  m.def("agreement", &py_agreement, "table"_a, "at"_a, "residuals"_a.noconvert(), "threshold"_a);
}
