// Marks of the rows that take part, and transforms, as several calls take them.
#pragma once

#include <algorithm>
#include <string>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/estimate/table.hpp"

using Chosen = In<bool, nb::ndim<1>>;

// As many marks as rows, and one of them at least.
inline const bool* checked_rows(const Chosen& chosen, const sonocal::Table& table) {
  if (chosen.shape(0) != static_cast<std::size_t>(table.rows))
    refuse("chosen has " + std::to_string(chosen.shape(0)) + " entries for " + std::to_string(table.rows) +
           " rows");
  require(std::find(chosen.data(), chosen.data() + table.rows, true) != chosen.data() + table.rows,
          "no row is chosen");
  return chosen.data();
}

inline void check_model(const sonocal::Table& table, const sonocal::Options& options) {
  require(table.dimension == 2 || options.model == sonocal::Model::kSimilarity,
          "the anisotropic model is of 2D images");
}
