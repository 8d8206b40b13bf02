#include "sonocal/igtl/crc64.hpp"

#include <array>

namespace sonocal {
namespace {

constexpr std::uint64_t kCrcPolynomial = 0x42F0E1EBA9EA3693;
constexpr int kSlices = 8;
using CrcTables = std::array<std::array<std::uint64_t, 256>, kSlices>;

// tables[k][b]: what a byte b contributes when k further bytes follow it.
CrcTables make_crc_tables() {
  CrcTables tables{};
  for (std::uint64_t byte = 0; byte < 256; ++byte) {
    std::uint64_t crc = byte << 56;
    for (int bit = 0; bit < 8; ++bit) crc = (crc << 1) ^ (crc >> 63 ? kCrcPolynomial : 0);
    tables[0][byte] = crc;
  }
  for (int slice = 1; slice < kSlices; ++slice)
    for (std::size_t byte = 0; byte < 256; ++byte) {
      const std::uint64_t before = tables[slice - 1][byte];
      tables[slice][byte] = (before << 8) ^ tables[0][before >> 56];
    }
  return tables;
}

}  // namespace

// Slicing by 8: a step of eight bytes is eight independent look-ups (Kounavis and Berry, A systematic
// approach to building high performance software-based CRC generators, ISCC 2005).
std::uint64_t crc64(const std::uint8_t* bytes, std::size_t count, std::uint64_t crc) {
  static const CrcTables tables = make_crc_tables();
  for (; count >= kSlices; bytes += kSlices, count -= kSlices) {
    std::uint64_t word = 0;
    for (int i = 0; i < kSlices; ++i) word = word << 8 | bytes[i];
    crc ^= word;
    std::uint64_t next = 0;
    for (int i = 0; i < kSlices; ++i) next ^= tables[i][crc >> (8 * i) & 0xff];
    crc = next;
  }
  for (; count > 0; ++bytes, --count) crc = (crc << 8) ^ tables[0][crc >> 56 ^ *bytes];
  return crc;
}

}  // namespace sonocal
