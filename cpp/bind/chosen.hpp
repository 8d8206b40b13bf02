// Marks of the rows that take part, and transforms, as several calls take them.
#pragma once

#include <algorithm>
#include <optional>
#include <string>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/estimate/table.hpp"

using Chosen = In<bool, nb::ndim<1>>;

// As many marks as rows, or correspondences, and one of them at least.
inline const bool* checked_marks(const Chosen& chosen, int count) {
  if (chosen.shape(0) != static_cast<std::size_t>(count))
    refuse("chosen has " + std::to_string(chosen.shape(0)) + " entries for " + std::to_string(count) +
           " rows");
  require(std::find(chosen.data(), chosen.data() + count, true) != chosen.data() + count, "no row is chosen");
  return chosen.data();
}
inline const bool* checked_rows(const Chosen& chosen, const sonocal::Table& table) {
  return checked_marks(chosen, table.rows);
}

using Residuals = In<double, nb::ndim<1>>;

// What a correspondence's residual is multiplied by.
inline const double* checked_weights(const std::optional<Residuals>& weights, int count) {
  if (!weights) return nullptr;
  require(weights->shape(0) == static_cast<std::size_t>(count), "weights are not one a correspondence");
  for (std::size_t i = 0; i < weights->shape(0); ++i)
    require(weights->data()[i] > 0 && weights->data()[i] <= 1, "weights are not above 0 and up to 1");
  return weights->data();
}

inline void check_scale(double scale) {
  constexpr double kMostScale = 1e30;  // products of coordinates stay numbers
  require(scale >= 0 && scale < kMostScale, "scale is not a number from 0 on");
}

// The options for a table: a scale of its own along every axis is three scales in a volume.
inline sonocal::Options options_for(int dimension, sonocal::Options options) {
  if (dimension == 3 && options.model == sonocal::Model::kAnisotropic)
    options.model = sonocal::Model::kVoxels;
  return options;
}
