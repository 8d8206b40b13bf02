// What residuals say of the noise: sums that variances follow from, and how spread the rows are.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <cmath>
#include <optional>
#include <set>
#include <vector>

#include "bind/chosen.hpp"
#include "bind/table.hpp"
#include "bind/white.hpp"
#include "sonocal/estimate/apparent.hpp"
#include "sonocal/estimate/drift.hpp"
#include "sonocal/estimate/extent.hpp"
#include "sonocal/estimate/residual_vectors.hpp"
#include "sonocal/estimate/shared_errors.hpp"
#include "sonocal/estimate/small_samples.hpp"
#include "sonocal/estimate/stretch.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

using Codes = In<std::int32_t, nb::ndim<1>>;
using Times = In<double, nb::ndim<1>>;
using Covariance = In<double, nb::ndim<2>>;

struct NoiseSums {
  std::vector<int> kept;
  Out<double> expected, observed, of_offsets, covariance;
  double freedom = 0;
  Drift drift;
  Out<double> widening, moved;
  double apparent = 0;
};

TangentMatrix tangent_matrix(const Covariance& values, const Options& options) {
  const auto k = static_cast<std::size_t>(parameter_count(options.model));
  require(values.shape(0) == k && values.shape(1) == k,
          "covariance has not as many rows and columns as the model has parameters");
  check_finite(values.data(), k * k, "covariance");
  const auto side = static_cast<Eigen::Index>(k);
  return Eigen::Map<const Eigen::MatrixXd>(values.data(), side, side).transpose();
}

std::vector<const std::int32_t*> checked_codes(const std::vector<Codes>& groupings, int rows) {
  std::vector<const std::int32_t*> out;
  for (const Codes& codes : groupings) {
    require(codes.shape(0) == static_cast<std::size_t>(rows),
            "a grouping has not as many entries as the table has rows");
    out.push_back(codes.data());
  }
  return out;
}

const double* checked_times(const Times& time, int rows) {
  require(time.shape(0) == static_cast<std::size_t>(rows),
          "time has not as many entries as the table has rows");
  check_finite(time.data(), time.shape(0), "time");
  return time.data();
}

Out<double> stacked(const std::vector<TangentMatrix>& matrices, std::size_t side) {
  std::vector<double> values;
  for (const TangentMatrix& m : matrices) values.insert(values.end(), m.data(), m.data() + m.size());
  return make_array(std::move(values), {matrices.size(), side, side});
}

// Derivatives of log variances by those of the levels' squares that were estimated; geometric: by the one
// there is.
Eigen::MatrixX2d by_unknown(const WhiteResiduals& white, const Options& options, bool known_px,
                            bool known_mm) {
  Eigen::MatrixX2d out = white.by_level;
  if (options.weighting == Weighting::kGeometric) {
    out.col(0).setOnes();
    out.col(1).setZero();
    return out;
  }
  out.col(0) *= known_px ? 0 : options.levels.px * options.levels.px;
  out.col(1) *= known_mm ? 0 : options.levels.mm * options.levels.mm;
  return out;
}

// Of the parts that pixels and segment ends have in the variances' sum.
double log_ratio(const WhiteResiduals& white, const Options& options) {
  const double px = white.by_levels[0] * options.levels.px * options.levels.px;
  const double mm = white.by_levels[1] * options.levels.mm * options.levels.mm;
  return px > 0 && mm > 0 ? std::log(px / mm) : 0;
}

NoiseSums noise_sums(const BoundTable& bound, const Chosen& chosen, const Transform& at, const Options& asked,
                     const std::optional<Covariance>& covariance, const std::vector<Codes>& groupings,
                     const std::optional<Times>& time, bool known_px, bool known_mm) {
  const Options options = options_for(bound.dimension(), asked);
  const std::vector<const std::int32_t*> codes = checked_codes(groupings, bound.rows());
  const double* times = time ? checked_times(*time, bound.rows()) : nullptr;
  TangentMatrix of_tangent = covariance ? tangent_matrix(*covariance, options) : TangentMatrix();
  const WhiteResiduals white = white_of(bound, chosen, at, options);
  SharedErrors shared;
  WiderCovariance wider;
  Drift drift;
  Apparent apparent;
  {
    nb::gil_scoped_release unlocked;
    if (!covariance) of_tangent = inverse_information(white.jacobian);
    // With the likelihood's weights, what the points of one sighting share is in the weights already.
    const bool weighted = options.weighting == Weighting::kLikelihood;
    const std::size_t units =
        weighted ? std::set<std::int32_t>(white.row.begin(), white.row.end()).size() : white.row.size() / 2;
    shared = shared_errors(white, codes, static_cast<int>(units), of_tangent);
    wider = small_sample_covariance(white.jacobian, by_unknown(white, options, known_px, known_mm),
                                    of_tangent, log_ratio(white, options));
    if (times != nullptr) drift = drift_of(white, times, bound.target_codes(), of_tangent);
    const double px_share = white.by_level.col(0).mean() * options.levels.px * options.levels.px;
    apparent = apparent_of(white, px_share, wider.ratio_variance, of_tangent);
  }
  return {shared.kept,
          to_numpy(shared.expected),
          to_numpy(shared.observed),
          stacked(shared.of_offsets, static_cast<std::size_t>(of_tangent.rows())),
          to_numpy(wider.covariance),
          wider.freedom,
          drift,
          to_numpy(apparent.widening),
          to_numpy(apparent.moved),
          apparent.share};
}

int py_stretch_length(const In<double, nb::shape<-1, 3>>& residuals, const Codes& frames) {
  const std::size_t rows = residuals.shape(0);
  require(rows > 0 && rows <= kMostRows, "there is between one residual and 2^28");
  require(frames.shape(0) == rows, "there are not as many frames as residuals");
  check_finite(residuals.data(), 3 * rows, "residuals");
  return stretch_length(residuals.data(), frames.data(), static_cast<int>(rows));
}

Out<double> py_residual_vectors(const BoundTable& bound, const Transform& at) {
  const Table table = bound.lines();
  return make_array(residual_vectors(table, at), {static_cast<std::size_t>(table.rows), 3});
}

Extent py_extent(const BoundTable& bound, const std::optional<Chosen>& chosen) {
  const Table table = bound.lines();
  return extent_of(table, chosen ? checked_rows(*chosen, table) : nullptr);
}

template <auto kVector>
Out<double> as_array(const Extent& e) {
  return to_numpy(e.*kVector);
}

}  // namespace

void bind_noise(nb::module_& m) {
  const auto owned = nb::rv_policy::automatic;
  nb::class_<Drift>(m, "Drift")
      .def_ro("gain", &Drift::gain)
      .def_ro("unit", &Drift::unit)
      .def_ro("wander", &Drift::wander)
      .def_ro("memory", &Drift::memory)
      .def_ro("stretches", &Drift::stretches)
      .def_ro("freedom", &Drift::freedom)
      .def_prop_ro("of_offsets", [](const Drift& drift) { return to_numpy(drift.of_offsets); }, owned);
  nb::class_<NoiseSums>(m, "NoiseSums")
      .def_ro("kept", &NoiseSums::kept)
      .def_ro("expected", &NoiseSums::expected, owned)
      .def_ro("observed", &NoiseSums::observed, owned)
      .def_ro("of_offsets", &NoiseSums::of_offsets, owned)
      .def_ro("covariance", &NoiseSums::covariance, owned)
      .def_ro("freedom", &NoiseSums::freedom)
      .def_ro("drift", &NoiseSums::drift)
      .def_ro("widening", &NoiseSums::widening, owned)
      .def_ro("moved", &NoiseSums::moved, owned)
      .def_ro("apparent", &NoiseSums::apparent);
  nb::class_<Extent>(m, "Extent")
      .def_ro("direction_spread", &Extent::direction_spread)
      .def_ro("meeting_distance", &Extent::meeting_distance)
      .def_prop_ro("common", &as_array<&Extent::common>, owned)
      .def_prop_ro("meeting", &as_array<&Extent::meeting>, owned)
      .def_prop_ro("ends", &as_array<&Extent::ends>, owned)
      .def_prop_ro("points", &as_array<&Extent::points>, owned);
  m.def("noise_sums", &noise_sums, "table"_a, "chosen"_a.noconvert(), "at"_a, "options"_a,
        "covariance"_a.noconvert().none(), "groupings"_a, nb::kw_only(),
        "time"_a.noconvert().none() = nb::none(), "known_px"_a, "known_mm"_a);
  m.def("residual_vectors", &py_residual_vectors, "table"_a, "at"_a);
  m.def("stretch_length", &py_stretch_length, "residuals"_a.noconvert(), "frames"_a.noconvert());
  m.def("extent", &py_extent, "table"_a, "chosen"_a.noconvert().none() = nb::none());
}
