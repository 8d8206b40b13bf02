// What the bindings of volumes share: arrays that are written into, and what is refused of boxes and images.
#pragma once

#include <string>

#include "bind/arrays.hpp"
#include "bind/checks.hpp"
#include "sonocal/reconstruction/rows.hpp"

template <class T, class... Shape>
using InOut = nb::ndarray<T, nb::numpy, nb::c_contig, nb::device::cpu, Shape...>;

constexpr std::size_t kMostSide = 1 << 14, kMostVoxels = std::size_t{1} << 36;

using Low = In<std::int32_t, nb::shape<3>>;
using Matrices = In<double, nb::shape<-1, 3, 4>>;

// A box whose lowest voxel and sides are no further than `kFarthest`; `layers` further voxels are on each
// side of it.
inline sonocal::Box box_of(const Low& low, std::size_t deep, std::size_t high, std::size_t wide, int layers) {
  sonocal::Box box;
  const std::size_t sides[3] = {wide, high, deep};
  for (int i = 0; i < 3; ++i) {
    require(sides[i] > 2 * static_cast<std::size_t>(layers) && sides[i] <= kMostSide + 2 * layers,
            "a box has between 1 and 2^14 voxels along each axis");
    require(std::abs(static_cast<double>(low.data()[i])) <= sonocal::kFarthest,
            "a box lies beyond 2^20 voxels");
    box.lo[i] = low.data()[i];
    box.size[i] = static_cast<int>(sides[i]) - 2 * layers;
  }
  return box;
}

inline void check_image(std::size_t height, std::size_t width) {
  require(width >= 2 && height >= 2 && width <= kMostSide && height <= kMostSide,
          "an image has between 2 and 2^14 pixels along each side");
}
