// Whether an answer is the best of all.
#include "sonocal/estimate/certificate.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <optional>
#include <string>

#include "bind/chosen.hpp"
#include "bind/table.hpp"

using namespace nb::literals;
using namespace sonocal;

namespace {

Certificate of_lines(const Table& table, const Chosen& chosen, const Transform& at, const Options& asked) {
  const Options options = options_for(table.dimension, asked);
  require(options.weighting == Weighting::kGeometric || options.levels.px > 0 || options.levels.mm > 0,
          "the likelihood's weights need a noise level");
  const bool* rows = checked_rows(chosen, table);
  nb::gil_scoped_release unlocked;
  return certificate(table, rows, at, options);
}

Certificate of_targets(const MixedTable& table, const Chosen& chosen, const Transform& at,
                       const Options& asked) {
  const Options options = options_for(table.dimension, asked);
  require(options.levels.px > 0 || options.levels.mm > 0, "the likelihood's weights need a noise level");
  const bool* marks = checked_marks(chosen, table.count);
  nb::gil_scoped_release unlocked;
  return certificate(table, marks, at, options);
}

std::string py_certificate(const BoundTable& bound, const Chosen& chosen, const Transform& at,
                           const Options& options, const std::optional<Residuals>& weights) {
  Certificate found;
  if (bound.of_points_and_lines()) {
    found = of_lines(bound.lines(), chosen, at, options);
  } else if (bound.of_points_and_targets()) {
    found = of_targets(bound.targets(), chosen, at, options);
  } else {
    const Correspondences all = bound.planes();
    const bool* marks = checked_marks(chosen, all.count);
    const double* factors = checked_weights(weights, all.count);
    nb::gil_scoped_release unlocked;
    found = certificate(all, marks, factors, options.scale, at);
  }
  return found == Certificate::kOptimal ? "optimal" : found == Certificate::kTied ? "tied" : "not shown";
}

}  // namespace

void bind_certificate(nb::module_& m) {
  m.def("certificate", &py_certificate, "table"_a, "chosen"_a.noconvert(), "at"_a, "options"_a, nb::kw_only(),
        "weights"_a.noconvert() = nb::none());
}
