// What every test of the core says when something does not hold.
#pragma once

#include <cstdio>

namespace sonocal {

inline int failures = 0;

inline void check(bool holds, const char* what) {
  if (holds) return;
  std::printf("FAILED: %s\n", what);
  ++failures;
}

inline int summary(const char* what) {
  std::printf(failures == 0 ? "%s hold\n" : "%s: %d checks failed\n", what, failures);
  return failures != 0;
}

}  // namespace sonocal
