#include "sonocal/solvers/lanes/kernels.hpp"

namespace sonocal {

extern const Kernels kernels_base;
#ifdef SONOCAL_X86_KERNELS
extern const Kernels kernels_avx2, kernels_avx512;

constexpr std::size_t kFew = 2;

const Kernels& kernels(std::size_t size) {
  static const Kernels& narrow =
      __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? kernels_avx2 : kernels_base;
  static const Kernels& wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                                       __builtin_cpu_supports("avx512dq")
                                   ? kernels_avx512
                                   : narrow;
  return size < kFew ? narrow : wide;
}
#else
const Kernels& kernels(std::size_t) { return kernels_base; }
#endif

}  // namespace sonocal
