// The checksum of OpenIGTLink's messages: CRC-64 of ECMA-182, from 0, not reflected.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sonocal {

// Of bytes that follow those whose checksum is `crc`; 0 where they are the first.
std::uint64_t crc64(const std::uint8_t* bytes, std::size_t count, std::uint64_t crc = 0);

}  // namespace sonocal
