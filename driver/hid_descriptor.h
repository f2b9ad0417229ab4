// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace forcegrid::driver {

/// One interface as its HID report descriptor describes it.
struct HidInterface {
  std::uint16_t usage_page = 0;  ///< of the first application collection
  std::uint16_t usage = 0;
  std::size_t input_bytes = 0;  ///< of all Input items, without report ID
  std::size_t output_bytes = 0;
  std::size_t feature_bytes = 0;
  bool has_report_ids = false;
};

/// Parses a HID report descriptor, strictly: a truncated item, an unknown item, unbalanced
/// collections or push/pop, a report that is no whole number of bytes or is absurdly long is an
/// error.
/// Source: USB Device Class Definition for HID 1.11, section 6.2.2.
/// @throws DeviceError naming the byte offset and what is wrong there.
/// Real-time: no; before the loop. Threads: any.
HidInterface parse_hid_descriptor(std::span<const std::uint8_t> descriptor);

}  // namespace forcegrid::driver
