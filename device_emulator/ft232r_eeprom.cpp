// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/ft232r_eeprom.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "device_emulator/usb.h"

namespace forcegrid::emulator {

namespace {

constexpr std::size_t kStringTable = 0x0E;
constexpr std::size_t kFirstString = 0x18;
constexpr std::size_t kChecksum = 0x7E;
constexpr std::uint8_t kStringAddressFlag = 0x80;
constexpr std::uint8_t kPacketsOf64Bytes = 0x40;
constexpr std::uint8_t kHasSerialNumber = 0x08;
// CBUS 0 to 4: TXLED, RXLED, TXDEN, PWREN, SLEEP.
constexpr std::array<std::uint8_t, 3> kCbusFunctions = {0x23, 0x10, 0x05};
constexpr std::size_t kMostCharacters = (kChecksum - kFirstString) / 2 - 3;
constexpr std::uint16_t kChecksumStart = 0xAAAA;

}  // namespace

Ft232rEeprom ft232r_eeprom(const profiles::DeviceProfile::Usb& usb, std::uint8_t attributes,
                           std::uint8_t max_power) {
  const std::size_t characters = usb.manufacturer.size() + usb.product.size() + usb.serial.size();
  if (characters > kMostCharacters) {
    throw std::invalid_argument(
        "usb.manufacturer, usb.product and usb.serial have " + std::to_string(characters) +
        " characters together; an FT232R has room for " + std::to_string(kMostCharacters));
  }
  std::array<std::uint8_t, 2 * std::tuple_size_v<Ft232rEeprom>> bytes{};
  const auto put_word = [&bytes](std::size_t at, std::uint16_t value) {
    bytes[at] = static_cast<std::uint8_t>(value & 0xFFU);
    bytes[at + 1] = static_cast<std::uint8_t>(value >> 8);
  };
  bytes[0x01] = kPacketsOf64Bytes;
  put_word(0x02, usb.vendor_id);
  put_word(0x04, usb.product_id);
  put_word(0x06, usb.device_release);
  bytes[0x08] = attributes;
  bytes[0x09] = max_power;
  bytes[0x0A] = kHasSerialNumber;
  std::copy(kCbusFunctions.begin(), kCbusFunctions.end(), bytes.begin() + 0x14);
  std::size_t at = kFirstString;
  std::size_t entry = kStringTable;
  for (const std::string* text : {&usb.manufacturer, &usb.product, &usb.serial}) {
    const std::vector<std::uint8_t> descriptor = usb_string_descriptor(*text);
    bytes[entry] = static_cast<std::uint8_t>(at | kStringAddressFlag);
    bytes[entry + 1] = static_cast<std::uint8_t>(descriptor.size());
    std::copy(descriptor.begin(), descriptor.end(),
              bytes.begin() + static_cast<std::ptrdiff_t>(at));
    entry += 2;
    at += descriptor.size();
  }
  Ft232rEeprom words{};
  std::uint16_t checksum = kChecksumStart;
  for (std::size_t i = 0; i + 1 < words.size(); ++i) {
    words[i] = static_cast<std::uint16_t>(bytes[2 * i] | bytes[2 * i + 1] << 8);
    checksum = std::rotl(static_cast<std::uint16_t>(checksum ^ words[i]), 1);
  }
  words.back() = checksum;
  return words;
}

}  // namespace forcegrid::emulator
