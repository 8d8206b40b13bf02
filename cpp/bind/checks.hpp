// What is refused at the door, in a sentence: behind it numbers are finite and lengths agree.
#pragma once

#include <nanobind/nanobind.h>

#include <cmath>
#include <cstddef>
#include <string>

// As many rows as an int counts with eight to spare.
constexpr std::size_t kMostRows = std::size_t{1} << 28;
// Products of four such numbers are finite still.
constexpr double kLargest = 1e60;

[[noreturn]] inline void refuse(const std::string& why) { throw nanobind::value_error(why.c_str()); }

inline void require(bool holds, const char* otherwise) {
  if (!holds) throw nanobind::value_error(otherwise);
}

inline bool usable(double x) { return std::abs(x) <= kLargest; }  // false for NaN, too

// More random samples than an hour could draw.
constexpr int kMostSamples = 1 << 30;

constexpr int kMostThreads = 1024;
inline void check_threads(int threads) {
  require(threads >= 1 && threads <= kMostThreads, "threads is not between 1 and 1024");
}

inline void check_finite(const double* values, std::size_t count, const char* name) {
  bool all = true;
  for (std::size_t i = 0; i < count; ++i) all &= usable(values[i]);
  if (!all) refuse(std::string(name) + " holds a number that is not finite, or beyond 1e60");
}
