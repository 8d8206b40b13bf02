#include "sonocal/solvers/lanes/kernels.hpp"
#include "sonocal/solvers/lanes/processor.hpp"

namespace sonocal {

extern const Kernels kernels_base;
#ifdef SONOCAL_X86_KERNELS
extern const Kernels kernels_avx2, kernels_avx512;

constexpr std::size_t kFew = 2;

const Kernels& kernels(std::size_t size) {
  static const Processor processor = this_processor();
  if (processor.avx512 && size >= kFew) return kernels_avx512;
  return processor.avx2 ? kernels_avx2 : kernels_base;
}
#else
const Kernels& kernels(std::size_t) { return kernels_base; }
#endif

}  // namespace sonocal
