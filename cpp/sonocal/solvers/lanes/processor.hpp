// What this processor can run, asked of it: compilers' own answers are missing or wrong where wheels are
// built.
#pragma once

namespace sonocal {

struct Processor {
  bool avx2;    // with fused multiply-add
  bool avx512;  // foundation, and its short vectors and doubles
};

Processor this_processor();

}  // namespace sonocal
