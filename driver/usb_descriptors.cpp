// SPDX-License-Identifier: Apache-2.0
#include "driver/usb_descriptors.h"

namespace forcegrid::driver {
namespace {

constexpr std::uint8_t kInterfaceDescriptor = 4;
constexpr std::uint8_t kEndpointDescriptor = 5;
constexpr std::uint8_t kHidDescriptor = 0x21;
constexpr std::uint8_t kHidClass = 3;
constexpr std::uint8_t kVendorClass = 0xFF;
constexpr std::uint8_t kBulk = 2;
constexpr std::uint8_t kInterrupt = 3;

}  // namespace

std::string utf8_of(std::span<const std::uint8_t> utf16) {
  std::string text;
  for (std::size_t i = 0; i + 1 < utf16.size(); i += 2) {
    const unsigned unit = little16(&utf16[i]);
    if (unit >= 0xD800 && unit < 0xE000) {
      text += '?';  // no device of this family has characters beyond the basic plane
    } else if (unit < 0x80) {
      text += unit < 0x20 ? '?' : static_cast<char>(unit);
    } else if (unit < 0x800) {
      text += static_cast<char>(0xC0 | (unit >> 6));
      text += static_cast<char>(0x80 | (unit & 0x3F));
    } else {
      text += static_cast<char>(0xE0 | (unit >> 12));
      text += static_cast<char>(0x80 | ((unit >> 6) & 0x3F));
      text += static_cast<char>(0x80 | (unit & 0x3F));
    }
  }
  return text;
}

std::optional<Endpoints> find_interface(std::span<const std::uint8_t> bytes, InterfaceKind kind) {
  const bool hid = kind == InterfaceKind::kHid;
  if (bytes.size() < 9) {
    return std::nullopt;
  }
  Endpoints candidate;
  bool is_wanted = false;
  std::size_t at = 0;
  while (bytes.size() - at >= 2) {
    const std::size_t length = bytes[at];
    if (length < 2 || length > bytes.size() - at) {
      return std::nullopt;
    }
    const auto item = bytes.subspan(at, length);
    if (item[1] == kInterfaceDescriptor && length >= 9) {
      candidate = Endpoints{.configuration = bytes[5], .interface = item[2]};
      is_wanted = item[5] == (hid ? kHidClass : kVendorClass) && item[3] == 0;
    } else if (hid && is_wanted && item[1] == kHidDescriptor && length >= 9 &&
               item[6] == kReportDescriptor) {
      candidate.report_descriptor_bytes = little16(&item[7]);
    } else if (is_wanted && item[1] == kEndpointDescriptor && length >= 7 &&
               (item[3] & 3) == (hid ? kInterrupt : kBulk)) {
      const auto packet_bytes = static_cast<std::uint16_t>(little16(&item[4]) & 0x7FF);
      if ((item[2] & 0x80) != 0 && candidate.in_endpoint == 0) {
        candidate.in_endpoint = item[2] & 0x0F;
        candidate.in_bytes = packet_bytes;
        candidate.in_interval = item[6];
      } else if ((item[2] & 0x80) == 0 && candidate.out_endpoint == 0) {
        candidate.out_endpoint = item[2] & 0x0F;
        candidate.out_interval = item[6];
      }
    }
    if (is_wanted && candidate.in_endpoint != 0 && candidate.out_endpoint != 0 &&
        (!hid || candidate.report_descriptor_bytes != 0)) {
      return candidate;
    }
    at += length;
  }
  return std::nullopt;
}

}  // namespace forcegrid::driver
