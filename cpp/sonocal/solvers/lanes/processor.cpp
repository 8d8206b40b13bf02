#include "sonocal/solvers/lanes/processor.hpp"

#if defined(__x86_64__) || defined(_M_X64)

#include <cpuid.h>

#include <cstdint>

namespace sonocal {

namespace {

// Registers that the system keeps when it changes threads: XCR0, of Intel's manual, volume 1, chapter 13.
constexpr std::uint64_t kYmm = 0x06, kZmm = 0xe6;

struct Leaf {
  unsigned a = 0, b = 0, c = 0, d = 0;
};

Leaf leaf(unsigned number) {
  Leaf of;  // zeros where the processor has no such leaf
  __get_cpuid_count(number, 0, &of.a, &of.b, &of.c, &of.d);
  return of;
}

bool has(unsigned word, unsigned bit) { return (word >> bit & 1) != 0; }

std::uint64_t kept_by_the_system() {
  unsigned low = 0, high = 0;
  __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  return std::uint64_t{high} << 32 | low;
}

}  // namespace

Processor this_processor() {
  const Leaf first = leaf(1), seventh = leaf(7);
  const bool xgetbv = has(first.c, 27);
  const std::uint64_t kept = xgetbv ? kept_by_the_system() : 0;
  const bool avx2 = (kept & kYmm) == kYmm && has(first.c, 12) && has(seventh.b, 5);
  const bool avx512 = (kept & kZmm) == kZmm && has(seventh.b, 16) && has(seventh.b, 17) && has(seventh.b, 31);
  return {avx2, avx2 && avx512};
}

}  // namespace sonocal

#else

namespace sonocal {

Processor this_processor() { return {false, false}; }

}  // namespace sonocal

#endif
