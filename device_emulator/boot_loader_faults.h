// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace forcegrid::emulator {

/// Where a boot loader can stop for good, in the order in which a host reaches these steps.
enum class BootStep : std::uint8_t {
  kGreeting,  ///< it does not answer the greeting
  kBaudRate,  ///< it does not return the character from which it learns the baud rate
  kStart,     ///< it receives and returns the whole image, but never starts it
};

/// The faults of a boot loader, which asks for them as it goes along.
/// Real-time: implementations neither allocate, lock nor throw.
class BootLoaderFaults {
 public:
  virtual ~BootLoaderFaults() = default;
  /// What the loader returns for `character`, which is byte `image_byte` of the image, from 0.
  [[nodiscard]] virtual std::uint8_t echo(std::uint64_t image_byte,
                                          std::uint8_t character) noexcept = 0;
  /// Whether it stops for good at `step`.
  [[nodiscard]] virtual bool stuck_at(BootStep step) noexcept = 0;
};

}  // namespace forcegrid::emulator
