#include "sonocal/reconstruction/cells.hpp"

namespace sonocal {

template <class Pixel>
void settle_cells(const std::uint64_t* cells, std::size_t count, Compounding how, std::uint64_t scale,
                  Pixel* values, std::uint32_t* counts) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t times = cells[i] >> kSumBits, sum = cells[i] & kSumMask;
    const std::uint64_t parts = scale * (how == Compounding::mean ? times : 1);
    values[i] = parts == 0 ? Pixel{0} : static_cast<Pixel>((2 * sum + parts) / (2 * parts));
    counts[i] = static_cast<std::uint32_t>(times);
  }
}

template void settle_cells(const std::uint64_t*, std::size_t, Compounding, std::uint64_t, std::uint8_t*,
                           std::uint32_t*);
template void settle_cells(const std::uint64_t*, std::size_t, Compounding, std::uint64_t, std::uint16_t*,
                           std::uint32_t*);

}  // namespace sonocal
