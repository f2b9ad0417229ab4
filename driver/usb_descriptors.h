// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace forcegrid::driver {

// Types of standard and HID descriptors.
inline constexpr std::uint8_t kDeviceDescriptor = 1;
inline constexpr std::uint8_t kConfigurationDescriptor = 2;
inline constexpr std::uint8_t kStringDescriptor = 3;
inline constexpr std::uint8_t kReportDescriptor = 0x22;

/// Descriptors are little-endian, unlike the USB/IP headers around them.
inline std::uint16_t little16(const std::uint8_t* bytes) noexcept {
  return static_cast<std::uint16_t>(bytes[0] | (bytes[1] << 8));
}

/// Which interface of a device the driver uses.
enum class InterfaceKind : std::uint8_t {
  kHid,     ///< with an interrupt endpoint each way
  kVendor,  ///< vendor-specific, with a bulk endpoint each way
};

/// Where reports go in and out.
struct Endpoints {
  std::uint8_t configuration = 0;
  std::uint8_t interface = 0;
  std::uint16_t report_descriptor_bytes = 0;
  std::uint8_t in_endpoint = 0;
  std::uint8_t out_endpoint = 0;
  std::uint16_t in_bytes = 0;
  std::uint8_t in_interval = 1;
  std::uint8_t out_interval = 1;
};

/// The first interface of `kind` in a configuration descriptor, in its first alternate setting.
/// @returns nothing if there is none, or if the descriptor is malformed before it.
/// Source: USB 2.0, section 9.6. Real-time: no allocation, lock or throw.
std::optional<Endpoints> find_interface(std::span<const std::uint8_t> bytes, InterfaceKind kind);

/// The text of a string descriptor as UTF-8. Control characters, and characters beyond the basic
/// plane, become '?'.
std::string utf8_of(std::span<const std::uint8_t> utf16);

}  // namespace forcegrid::driver
