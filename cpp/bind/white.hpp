// White residuals of whichever table.
#pragma once

#include "bind/chosen.hpp"
#include "bind/table.hpp"
#include "sonocal/estimate/white_residuals.hpp"

// Of either kind of table; marks are of its rows, or of a mix' sightings.
inline sonocal::WhiteResiduals white_of(const BoundTable& bound, const Chosen& chosen,
                                        const sonocal::Transform& at, const sonocal::Options& asked) {
  if (bound.of_points_and_targets()) {
    const sonocal::MixedTable table = bound.targets();
    const sonocal::Options options = options_for(table.dimension, asked);
    const bool* marks = checked_marks(chosen, table.count);
    nb::gil_scoped_release unlocked;
    return white_residuals(table, marks, at, options);
  }
  const sonocal::Table table = bound.lines();
  const sonocal::Options options = options_for(table.dimension, asked);
  const bool* marks = checked_rows(chosen, table);
  nb::gil_scoped_release unlocked;
  return white_residuals(table, marks, at, options);
}
