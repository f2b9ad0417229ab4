// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/usb.h"

#include <algorithm>
#include <stdexcept>

#include "device_emulator/usb_numbers.h"

namespace forcegrid::emulator {

namespace {

constexpr std::size_t kMaxStringLength = 126;  // bLength is one byte

}  // namespace

SetupPacket SetupPacket::from_bytes(std::span<const std::uint8_t, 8> bytes) noexcept {
  const auto little_endian = [&bytes](std::size_t at) {
    return static_cast<std::uint16_t>(bytes[at] | (bytes[at + 1] << 8));
  };
  return {bytes[0], bytes[1], little_endian(2), little_endian(4), little_endian(6)};
}

std::vector<std::uint8_t> usb_string_descriptor(const std::string& text) {
  if (text.size() > kMaxStringLength ||
      std::any_of(text.begin(), text.end(), [](char c) { return c < 0x20 || c > 0x7E; })) {
    throw std::invalid_argument("USB string '" + text +
                                "' can't be emulated; use at most 126 printable ASCII characters");
  }
  std::vector<std::uint8_t> bytes{static_cast<std::uint8_t>(2 + 2 * text.size()),
                                  usb::kDescriptorString};
  for (const char character : text) {
    bytes.push_back(static_cast<std::uint8_t>(character));
    bytes.push_back(0);
  }
  return bytes;
}

}  // namespace forcegrid::emulator
