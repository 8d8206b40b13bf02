// Where mapped points lie, seen from their lines.
#pragma once

#include <vector>

#include "sonocal/estimate/table.hpp"

namespace sonocal {

// N x 3, mm: from each line to its mapped point, at right angles to the line.
std::vector<double> residual_vectors(const Table& table, const Transform& at);

}  // namespace sonocal
