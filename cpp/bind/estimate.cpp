// The whole estimate in one call, refinement alone, and whitened residuals.
#include "sonocal/estimate/estimate.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <optional>
#include <string>
#include <tuple>

#include "bind/arrays.hpp"
#include "sonocal/correspondences/correspondences.hpp"
#include "sonocal/estimate/white_residuals.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using Points = In<double, nb::shape<-1, 3>>;
using Segments = In<double, nb::shape<-1, 2, 3>>;
using Codes = std::optional<In<std::int32_t, nb::ndim<1>>>;
using Factors = std::optional<In<double, nb::ndim<1>>>;
using Chosen = In<bool, nb::ndim<1>>;

template <class Array>
auto data_of(const std::optional<Array>& array, std::size_t rows) -> decltype(array->data()) {
  if (!array) return nullptr;
  if (array->shape(0) != rows) throw nb::value_error("the arrays differ in their number of rows");
  return array->data();
}

Table table_of(const Points& points, const Segments& segments, const Codes& sightings, const Codes& frames,
               const Codes& targets, const Factors& noise_px, const Factors& noise_mm, int dimension) {
  const std::size_t n = points.shape(0);
  if (segments.shape(0) != n) throw nb::value_error("the arrays differ in their number of rows");
  return {points.data(),
          segments.data(),
          data_of(sightings, n),
          {data_of(frames, n), data_of(targets, n)},
          {data_of(noise_px, n), data_of(noise_mm, n)},
          static_cast<int>(n),
          dimension};
}

Model model_named(const std::string& name) {
  if (name == "similarity") return Model::kSimilarity;
  if (name == "anisotropic") return Model::kAnisotropic;
  throw nb::value_error(("no such model: " + name).c_str());
}

Weighting weighting_named(const std::string& name) {
  if (name == "geometric") return Weighting::kGeometric;
  if (name == "likelihood") return Weighting::kLikelihood;
  throw nb::value_error(("no such weighting: " + name).c_str());
}

struct PyEstimate {
  bool found, converged;
  int inliers, samples;
  double threshold_mm, level_px, level_mm, least_information;
  Out<double> rotation, translation, scales, residuals_mm, covariance;
};

PyEstimate to_python(const Estimate& e) {
  const PointLines::Column residuals = e.squares.sqrt();
  return {e.found,
          e.converged,
          e.inliers,
          e.samples,
          e.threshold_mm,
          e.levels.px,
          e.levels.mm,
          e.least_information,
          to_numpy(e.transform.rotation),
          to_numpy(e.transform.translation),
          to_numpy(e.transform.scales),
          to_numpy(residuals.matrix()),
          to_numpy(e.covariance)};
}

using Rotation = In<double, nb::shape<3, 3>>;
using Vector = In<double, nb::shape<3>>;

Transform transform_of(const Rotation& rotation, const Vector& translation, const Vector& scales) {
  using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  return {Eigen::Map<const RowMajor3>(rotation.data()), Eigen::Map<const Vector3d>(translation.data()),
          Eigen::Map<const Vector3d>(scales.data())};
}

PyEstimate py_estimate(Points points, Segments segments, Codes sightings, Codes frames, Codes targets,
                       Factors noise_px, Factors noise_mm, int dimension, const std::string& model,
                       const std::string& weighting, double threshold_mm, double level_px, double level_mm,
                       double confidence, int max_samples, int exhaustive_samples, std::uint64_t seed) {
  const Table table = table_of(points, segments, sightings, frames, targets, noise_px, noise_mm, dimension);
  const Options options{model_named(model),
                        weighting_named(weighting),
                        threshold_mm,
                        {level_px, level_mm},
                        {confidence, max_samples, exhaustive_samples, seed}};
  Estimate result;
  {
    nb::gil_scoped_release unlocked;
    result = estimate(table, options);
  }
  return to_python(result);
}

PyEstimate py_refine(Points points, Segments segments, Codes sightings, Factors noise_px, Factors noise_mm,
                     Chosen chosen, Rotation rotation, Vector translation, Vector scales, int dimension,
                     const std::string& model, const std::string& weighting, double level_px,
                     double level_mm) {
  const Table table = table_of(points, segments, sightings, {}, {}, noise_px, noise_mm, dimension);
  const Options options{model_named(model), weighting_named(weighting), 0, {level_px, level_mm}, {}};
  Estimate result;
  {
    nb::gil_scoped_release unlocked;
    result = refine_chosen(table, chosen.data(), transform_of(rotation, translation, scales), options);
  }
  return to_python(result);
}

// Transform, squared distance of each correspondence, their number that agree, samples, found, converged.
auto py_estimate_correspondences(Points points, In<double, nb::shape<-1, 4>> planes,
                                 In<std::int32_t, nb::ndim<1>> first, double threshold_mm, bool refine,
                                 double confidence, int max_samples, std::uint64_t seed) {
  const std::size_t count = first.shape(0) - 1;
  if (first.shape(0) < 2 || points.shape(0) != planes.shape(0) ||
      static_cast<std::size_t>(first.data()[count]) != points.shape(0))
    throw nb::value_error("the arrays differ in their number of rows");
  const Correspondences all{points.data(), planes.data(), first.data(), static_cast<int>(count)};
  CorrespondenceEstimate e;
  {
    nb::gil_scoped_release unlocked;
    e = estimate(all, {threshold_mm, refine, {confidence, max_samples, 0, seed}});
  }
  const std::size_t size = e.squares.size();
  return std::make_tuple(to_numpy(e.transform.rotation), to_numpy(e.transform.translation),
                         e.transform.scales[0], make_array(std::move(e.squares), {size}), e.inliers,
                         e.samples, e.found, e.converged);
}

auto py_white_residuals(Points points, Segments segments, Codes sightings, Factors noise_px, Factors noise_mm,
                        Chosen chosen, Rotation rotation, Vector translation, Vector scales, int dimension,
                        const std::string& model, const std::string& weighting, double level_px,
                        double level_mm) {
  const Table table = table_of(points, segments, sightings, {}, {}, noise_px, noise_mm, dimension);
  const Options options{model_named(model), weighting_named(weighting), 0, {level_px, level_mm}, {}};
  WhiteResiduals white;
  {
    nb::gil_scoped_release unlocked;
    white = white_residuals(table, chosen.data(), transform_of(rotation, translation, scales), options);
  }
  const std::size_t count = white.row.size();
  return std::make_tuple(to_numpy(white.jacobian), to_numpy(white.shift), to_numpy(white.by_level),
                         to_numpy(white.residual), make_array(std::move(white.row), {count}));
}

}  // namespace

void bind_estimate(nb::module_& m) {
  const auto owned = nb::rv_policy::automatic;
  nb::class_<PyEstimate>(m, "Estimate")
      .def_ro("found", &PyEstimate::found)
      .def_ro("converged", &PyEstimate::converged)
      .def_ro("inliers", &PyEstimate::inliers)
      .def_ro("samples", &PyEstimate::samples)
      .def_ro("threshold_mm", &PyEstimate::threshold_mm)
      .def_ro("level_px", &PyEstimate::level_px)
      .def_ro("level_mm", &PyEstimate::level_mm)
      .def_ro("least_information", &PyEstimate::least_information)
      .def_ro("rotation", &PyEstimate::rotation, owned)
      .def_ro("translation", &PyEstimate::translation, owned)
      .def_ro("scales", &PyEstimate::scales, owned)
      .def_ro("residuals_mm", &PyEstimate::residuals_mm, owned)
      .def_ro("covariance", &PyEstimate::covariance, owned);
  m.def("estimate", &py_estimate, "points"_a.noconvert(), "segments"_a.noconvert(),
        "sightings"_a.noconvert().none(), "frames"_a.noconvert().none(), "targets"_a.noconvert().none(),
        "noise_px"_a.noconvert().none(), "noise_mm"_a.noconvert().none(), nb::kw_only(), "dimension"_a,
        "model"_a, "weighting"_a, "threshold_mm"_a, "level_px"_a, "level_mm"_a, "confidence"_a,
        "max_samples"_a, "exhaustive_samples"_a, "seed"_a);
  m.def("refine", &py_refine, "points"_a.noconvert(), "segments"_a.noconvert(),
        "sightings"_a.noconvert().none(), "noise_px"_a.noconvert().none(), "noise_mm"_a.noconvert().none(),
        "chosen"_a.noconvert(), "rotation"_a.noconvert(), "translation"_a.noconvert(), "scales"_a.noconvert(),
        nb::kw_only(), "dimension"_a, "model"_a, "weighting"_a, "level_px"_a, "level_mm"_a);
  m.def("estimate_correspondences", &py_estimate_correspondences, "points"_a.noconvert(),
        "planes"_a.noconvert(), "first"_a.noconvert(), nb::kw_only(), "threshold_mm"_a, "refine"_a,
        "confidence"_a, "max_samples"_a, "seed"_a);
  m.def("white_residuals", &py_white_residuals, "points"_a.noconvert(), "segments"_a.noconvert(),
        "sightings"_a.noconvert().none(), "noise_px"_a.noconvert().none(), "noise_mm"_a.noconvert().none(),
        "chosen"_a.noconvert(), "rotation"_a.noconvert(), "translation"_a.noconvert(), "scales"_a.noconvert(),
        nb::kw_only(), "dimension"_a, "model"_a, "weighting"_a, "level_px"_a, "level_mm"_a);
}
