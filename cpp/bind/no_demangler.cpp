// A wheel brings the C++ library with it. What spells out names of C++ types there is 0.1 MB of code, and
// serves messages on types that Python does not know; nanobind shows the name as it is where it gets none.
#include <cxxabi.h>

#include <cstddef>

extern "C" char* __cxa_demangle(const char*, char*, std::size_t*, int* status) {
  constexpr int kNoSuchName = -2;
  if (status) *status = kNoSuchName;
  return nullptr;
}
