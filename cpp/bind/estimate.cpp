// The whole estimate in one call.
#include <nanobind/stl/string.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "bind/arrays.hpp"
#include "sonocal/consensus.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

// The tangent's map from normalised to original coordinates: the rotation turns about the image's
// centre there and about its origin here, so a turn and a growth move the origin too.
TangentMatrix tangent_to_original(const Transform& original, const Normalisation& normalisation,
                                  Model model) {
  const int k = parameter_count(model);
  const Matrix3d s = original.linear();
  const Vector3d centre = normalisation.image_centre;
  TangentMatrix map = TangentMatrix::Identity(k, k);
  map.block<3, 3>(3, 0) = cross_matrix(s * centre);
  map.block<3, 3>(3, 3) *= normalisation.size;
  if (model == Model::kSimilarity)
    map.block<3, 1>(3, 6) = -s * centre;
  else
    for (int axis = 0; axis < 2; ++axis) map.block<3, 1>(3, 6 + axis) = -s.col(axis) * centre[axis];
  return map;
}

struct PyEstimate {
  bool found, converged;
  int inliers, samples, best_count;
  Out<double> rotation, translation, scales, squares;
  // (J'J)^-1: the tangent's covariance for residuals of 1 mm; NaN where a motion is free.
  Out<double> unit_covariance;
  // Least eigenvalue of J'J a row, in coordinates of order one: zero where a motion is free.
  double least_information;
};

PyEstimate to_python(const Estimate& result, const PointLines& rows, Model model) {
  const int k = parameter_count(model);
  TangentMatrix covariance = TangentMatrix::Constant(k, k, kNaN);
  double least = 0;
  if (result.found) {
    least =
        Eigen::SelfAdjointEigenSolver<TangentMatrix>(result.information).eigenvalues()[0] / result.inliers;
    const TangentMatrix map = tangent_to_original(result.transform, rows.normalisation(), model);
    const double size = rows.normalisation().size;
    if (least > 0) covariance = map * result.information.inverse() * map.transpose() / (size * size);
  }
  return {result.found,
          result.converged,
          result.inliers,
          result.samples,
          result.best_count,
          to_numpy(result.transform.rotation),
          to_numpy(result.transform.translation),
          to_numpy(result.transform.scales),
          to_numpy(result.squares.matrix()),
          to_numpy(covariance),
          least};
}

Model model_named(const std::string& name) {
  if (name == "similarity") return Model::kSimilarity;
  if (name == "anisotropic") return Model::kAnisotropic;
  throw nb::value_error(("no such model: " + name).c_str());
}

using Points = In<double, nb::shape<-1, 3>>;
using Segments = In<double, nb::shape<-1, 2, 3>>;

void check_lengths(std::size_t points, std::size_t segments, std::size_t third) {
  if (points != segments || points != third)
    throw nb::value_error("the arrays differ in their number of rows");
}

PyEstimate estimate_calibration(Points points, Segments segments, In<std::int32_t, nb::ndim<1>> sightings,
                                int dimension, const std::string& model, double threshold_mm,
                                double confidence, int max_samples, int exhaustive_samples,
                                std::uint64_t seed) {
  const std::size_t n = points.shape(0);
  check_lengths(n, segments.shape(0), sightings.shape(0));
  Options options;
  options.model = model_named(model);
  options.threshold_mm = threshold_mm;
  options.confidence = confidence;
  options.max_samples = max_samples;
  options.exhaustive_samples = exhaustive_samples;
  options.seed = seed;
  nb::gil_scoped_release unlocked;
  const PointLines rows(points.data(), segments.data(), static_cast<int>(n), dimension);
  const Estimate result = estimate(rows, std::vector<int>(sightings.data(), sightings.data() + n), options);
  nb::gil_scoped_acquire locked;
  return to_python(result, rows, options.model);
}

PyEstimate refine_calibration(Points points, Segments segments, In<bool, nb::ndim<1>> chosen,
                              In<double, nb::shape<3, 3>> rotation, In<double, nb::shape<3>> translation,
                              In<double, nb::shape<3>> scales, int dimension, const std::string& model,
                              int max_iterations) {
  const std::size_t n = points.shape(0);
  check_lengths(n, segments.shape(0), chosen.shape(0));
  using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  const Transform start{Eigen::Map<const RowMajor3>(rotation.data()),
                        Eigen::Map<const Vector3d>(translation.data()),
                        Eigen::Map<const Vector3d>(scales.data())};
  const Model wanted = model_named(model);
  nb::gil_scoped_release unlocked;
  const PointLines rows(points.data(), segments.data(), static_cast<int>(n), dimension);
  const Estimate result = refine_chosen(rows, chosen.data(), start, wanted, max_iterations);
  nb::gil_scoped_acquire locked;
  return to_python(result, rows, wanted);
}

}  // namespace

void bind_estimate(nb::module_& m) {
  nb::class_<PyEstimate>(m, "Estimate")
      .def_ro("found", &PyEstimate::found)
      .def_ro("converged", &PyEstimate::converged)
      .def_ro("inliers", &PyEstimate::inliers)
      .def_ro("samples", &PyEstimate::samples)
      .def_ro("best_count", &PyEstimate::best_count)
      .def_ro("rotation", &PyEstimate::rotation, nb::rv_policy::automatic)
      .def_ro("translation", &PyEstimate::translation, nb::rv_policy::automatic)
      .def_ro("scales", &PyEstimate::scales, nb::rv_policy::automatic)
      .def_ro("squares", &PyEstimate::squares, nb::rv_policy::automatic)
      .def_ro("unit_covariance", &PyEstimate::unit_covariance, nb::rv_policy::automatic)
      .def_ro("least_information", &PyEstimate::least_information);
  m.def("estimate_calibration", &estimate_calibration, "points"_a.noconvert(), "segments"_a.noconvert(),
        "sightings"_a.noconvert(), nb::kw_only(), "dimension"_a, "model"_a, "threshold_mm"_a, "confidence"_a,
        "max_samples"_a, "exhaustive_samples"_a, "seed"_a);
  m.def("refine_calibration", &refine_calibration, "points"_a.noconvert(), "segments"_a.noconvert(),
        "chosen"_a.noconvert(), "rotation"_a.noconvert(), "translation"_a.noconvert(), "scales"_a.noconvert(),
        nb::kw_only(), "dimension"_a, "model"_a, "max_iterations"_a);
}
