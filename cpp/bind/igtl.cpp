// The checksum of OpenIGTLink's messages.
#include "bind/arrays.hpp"
#include "sonocal/igtl/crc64.hpp"

using namespace nb::literals;

namespace {

std::uint64_t crc64_of(In<std::uint8_t, nb::shape<-1>> bytes, std::uint64_t crc) {
  nb::gil_scoped_release unlocked;
  return sonocal::crc64(bytes.data(), bytes.size(), crc);
}

}  // namespace

void bind_igtl(nb::module_& m) { m.def("crc64", &crc64_of, "bytes"_a.noconvert(), "crc"_a = 0); }
