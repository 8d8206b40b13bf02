// Compiled once for each kind of machine, with SONOCAL_KERNELS the name of the table to fill, and
// SONOCAL_KIND the kind's.
#include "sonocal/solvers/lanes/kernels.hpp"

#include "sonocal/solvers/lanes/four_points_lanes.hpp"
#include "sonocal/solvers/lanes/three_quadrics_lanes.hpp"
#include "sonocal/solvers/lanes/two_conics_lanes.hpp"
#include "sonocal/solvers/lanes/two_lines_lanes.hpp"

namespace sonocal {

extern const Kernels SONOCAL_KERNELS;
const Kernels SONOCAL_KERNELS{
    SONOCAL_KIND,
    [](const double* points, const double* segments, std::size_t size, bool real_parts, BatchOut out) {
      four_points_range(points, segments, size, real_parts, out);
    },
    [](const double* image, const double* needles, std::size_t size, BatchOut out) {
      two_lines_range(image, needles, size, out);
    },
    [](const double* points, const double* planes, std::size_t size, int rows, double scale, bool real_parts,
       BatchOut out) { three_quadrics_range(points, planes, size, rows, scale, real_parts, out); },
    [](const double* points, const double* planes, std::size_t size, int rows, bool real_parts,
       BatchOut out) { two_conics_range(points, planes, size, rows, real_parts, out); }};

}  // namespace sonocal
