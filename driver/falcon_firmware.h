// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace forcegrid::driver::falcon {
#pragma GCC visibility push(default)

/// Firmware as the Falcon's boot loader takes it, checked.
struct Firmware {
  std::string name;                 ///< where it came from, for messages
  std::vector<std::uint8_t> bytes;  ///< empty: none
};

/// Checks that `bytes` are a boot stream, from the first to the last byte: little-endian 16-bit
/// words, the key 0x08AA, eight reserved zeros, an entry address that is not zero, then blocks
/// (size, destination, data words) up to a block of size 0, after which nothing follows.
/// @param name  for messages.
/// @throws DeviceError naming `name`, the byte and what is wrong there.
/// Source: device fact sheet, section 4.4. Real-time: no. Threads: any.
void check_firmware(std::span<const std::uint8_t> bytes, const std::string& name);

/// Reads and checks a file.
/// @throws DeviceError for a file that can't be read (saying where one gets such a file) and as
///         check_firmware().
/// Real-time: no. Threads: any.
Firmware load_firmware(const std::string& file);

/// An image without any program, 24 bytes: enough for an emulated Falcon, which looks at the stream
/// and runs its own model. A real one would find nothing to execute.
Firmware synthetic_firmware();

/// Where one gets firmware for a real Falcon; one sentence.
const char* firmware_advice() noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::driver::falcon
