// One formula for one problem or for several at a time.
//
// The closed forms below are chains of divisions and square roots, so a processor that solves one problem
// waits most of the time. Written for a number type T they run on a double or on a Pack of as many problems
// as a vector register holds, lane by lane; no lane sees another, so a NaN stays in its own.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

// Forced, because this code is compiled once for every kind of machine: a copy that the linker could share
// between them would bring one machine's instructions to another.
#ifndef SONOCAL_INLINE
#define SONOCAL_INLINE inline __attribute__((always_inline))
#endif
// Long, and called from several places: one copy for each kind of machine, which no other kind can see.
#define SONOCAL_APART static __attribute__((noinline))

namespace sonocal {

// As many as a register of the machine compiled for holds: wider ones are taken apart, and slowly.
#if defined(__AVX512F__)
constexpr int kWidth = 8;
#elif defined(__AVX2__)
constexpr int kWidth = 4;
#else
constexpr int kWidth = 2;
#endif
typedef double Pack __attribute__((vector_size(kWidth * sizeof(double))));
typedef std::int64_t PackMask __attribute__((vector_size(kWidth * sizeof(double))));

template <class T>
constexpr int kLanes = sizeof(T) / sizeof(double);
template <class T>
struct MaskType {
  using type = PackMask;
};
template <>
struct MaskType<double> {
  using type = bool;
};
template <class T>
using Mask = typename MaskType<T>::type;

template <class T>
SONOCAL_INLINE T broadcast(double value) {
  return T{} + value;
}

template <class T>
SONOCAL_INLINE double lane(const T& x, int i) {
  if constexpr (kLanes<T> == 1)
    return x;
  else
    return x[i];
}
template <class T>
SONOCAL_INLINE void set_lane(T& x, int i, double value) {
  if constexpr (kLanes<T> == 1)
    x = value;
  else
    x[i] = value;
}

// Lane i of the result is lane from[i] of x.
SONOCAL_INLINE Pack from_lanes(const Pack& x, const PackMask& from) {
#if defined(__GNUC__) && !defined(__clang__)
  return __builtin_shuffle(x, from);
#else
  Pack out;
  for (int i = 0; i < kWidth; ++i) out[i] = x[from[i]];
  return out;
#endif
}

SONOCAL_INLINE bool any(bool mask) { return mask; }
SONOCAL_INLINE bool any(const PackMask& mask) {
  std::int64_t bits = 0;
  for (int i = 0; i < kWidth; ++i) bits |= mask[i];
  return bits != 0;
}

template <class M, class T>
SONOCAL_INLINE T select(const M& mask, const T& yes, const T& no) {
  return mask ? yes : no;
}

template <class T>
SONOCAL_INLINE T sqrt(const T& x) {
  T out{};
  for (int i = 0; i < kLanes<T>; ++i) set_lane(out, i, std::sqrt(lane(x, i)));
  return out;
}
template <class T>
SONOCAL_INLINE T abs(const T& x) {
  return select(x < 0.0, -x, x);
}
template <class T>
SONOCAL_INLINE T larger(const T& x, const T& y) {
  return select(x > y, x, y);
}
template <class T>
SONOCAL_INLINE T with_sign(const T& magnitude, const T& sign) {
  return select(sign < 0.0, -magnitude, magnitude);
}
template <class T>
SONOCAL_INLINE Mask<T> finite(const T& x) {
  return x - x == 0.0;
}

// x^(1/3) of x >= 0 to 1e-9: a third of the exponent, then Halley. Roots that start here are polished.
SONOCAL_INLINE double third_of_exponent(double x) {
  std::uint64_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  bits = bits / 3 + 0x2A9F7893782DA1CEULL;
  std::memcpy(&x, &bits, sizeof x);
  return x;
}
template <class T>
SONOCAL_INLINE T cube_root(const T& x) {
  T y{};
  for (int i = 0; i < kLanes<T>; ++i) set_lane(y, i, third_of_exponent(lane(x, i)));
  for (int iteration = 0; iteration < 2; ++iteration) {
    const T cube = y * y * y;
    y = y * (cube + 2.0 * x) / (2.0 * cube + x);
  }
  return select(x > 0.0, y, T{});
}

template <class T>
struct Vec3 {
  T x, y, z;
};
template <class T>
SONOCAL_INLINE Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
SONOCAL_INLINE Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T>
SONOCAL_INLINE Vec3<T> operator*(const T& s, const Vec3<T>& a) {
  return {s * a.x, s * a.y, s * a.z};
}
template <class M, class T>
SONOCAL_INLINE Vec3<T> select_vec(const M& mask, const Vec3<T>& yes, const Vec3<T>& no) {
  return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}
template <class T>
SONOCAL_INLINE T dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
SONOCAL_INLINE Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
SONOCAL_INLINE Vec3<T> unit(const Vec3<T>& a) {
  return (1.0 / sqrt(dot(a, a))) * a;
}
template <class T>
SONOCAL_INLINE void swap_where(const Mask<T>& mask, T& a, T& b) {
  const T old = a;
  a = select(mask, b, a);
  b = select(mask, old, b);
}
template <class T>
SONOCAL_INLINE void swap_where(const Mask<T>& mask, Vec3<T>& a, Vec3<T>& b) {
  swap_where<T>(mask, a.x, b.x);
  swap_where<T>(mask, a.y, b.y);
  swap_where<T>(mask, a.z, b.z);
}

// A similarity of every lane, and in which lanes it is one.
template <class T>
struct Candidate {
  Vec3<T> column[3], translation;  // of the rotation
  T scale;
  Mask<T> valid;
};

}  // namespace sonocal
