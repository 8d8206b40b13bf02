// The two kinds of numbers that PLUS reckons voxels in: doubles, and fixed point with 14 bits behind the
// point.
//
// Source: IGSIO, vtkIGSIOPasteSliceIntoVolume and igsioMath (Perk Lab, Queen's University; Atamai; D. Pace),
// of which the arithmetic is followed so that volumes are equal to the voxel, and no line is taken.
#pragma once

#include <cmath>
#include <cstdint>

namespace sonocal::plus {

struct Fixed {
  static constexpr int kBits = 14;
  std::int32_t i;

  static Fixed of(double x) { return {static_cast<std::int32_t>(std::llrint(x * (1 << kBits)))}; }
  static Fixed whole(std::int32_t x) { return {x * (1 << kBits)}; }
};

inline Fixed operator+(Fixed a, Fixed b) { return {a.i + b.i}; }
inline Fixed operator-(Fixed a, Fixed b) { return {a.i - b.i}; }
inline Fixed operator*(Fixed a, Fixed b) { return {(a.i * b.i + (1 << (Fixed::kBits - 1))) >> Fixed::kBits}; }
inline Fixed operator*(Fixed a, int b) { return {a.i * b}; }
inline Fixed operator/(Fixed a, Fixed b) { return Fixed::of(static_cast<double>(a.i) / b.i); }
inline bool operator<(Fixed a, Fixed b) { return a.i < b.i; }
inline int floor_of(Fixed a) { return a.i >> Fixed::kBits; }
inline int round_of(Fixed a) { return (a.i + (1 << (Fixed::kBits - 1))) >> Fixed::kBits; }
inline bool is_zero(Fixed a) { return a.i == 0; }

// Added to a double, it leaves 16 bits behind the point: what lacks less than 2^-17 to a whole number becomes
// one.
constexpr double kShift = 103079215104.0;
inline int floor_of(double x) {
  return static_cast<int>(static_cast<std::int64_t>(x + kShift) - 103079215104LL);
}
inline int round_of(double x) {
  return static_cast<int>(static_cast<std::int64_t>(x + (kShift + 0.5)) - 103079215104LL);
}
inline bool is_zero(double x) { return x == 0; }

template <class Number>
Number from(double x);
template <>
inline double from<double>(double x) {
  return x;
}
template <>
inline Fixed from<Fixed>(double x) {
  return Fixed::of(x);
}
template <class Number>
Number whole(int x);
template <>
inline double whole<double>(int x) {
  return x;
}
template <>
inline Fixed whole<Fixed>(int x) {
  return Fixed::whole(x);
}

}  // namespace sonocal::plus
