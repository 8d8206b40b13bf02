#include "sonocal/solvers/two_conics.hpp"

namespace sonocal {

void two_conics_batch(const double* points, const double* planes, std::size_t size, int rows,
                      NoRealRoot policy, int threads, BatchOut out) {
  in_threads(size, threads, [&](std::size_t begin, std::size_t end) {
    kernels(size).two_conics(points + begin * rows * 3, planes + begin * rows * 4, end - begin, rows,
                             policy == NoRealRoot::kRealPart,
                             {out.matrices + begin * 64, out.counts + begin});
  });
}

}  // namespace sonocal
