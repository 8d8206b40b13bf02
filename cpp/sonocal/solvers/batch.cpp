#include "sonocal/solvers/batch.hpp"

namespace sonocal {

extern const Kernels kernels_base;
#ifdef SONOCAL_X86_KERNELS
extern const Kernels kernels_avx2, kernels_avx512;

const Kernels& kernels() {
  static const Kernels& best = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                                       __builtin_cpu_supports("avx512dq")
                                   ? kernels_avx512
                               : __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")
                                   ? kernels_avx2
                                   : kernels_base;
  return best;
}
#else
const Kernels& kernels() { return kernels_base; }
#endif

}  // namespace sonocal
