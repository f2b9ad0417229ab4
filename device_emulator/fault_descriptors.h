// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace forcegrid::emulator {

/// Which of a device's descriptors a set of mutations changes, and how. A set is a number: the same
/// number always mutates the same way, also when a host asks for a descriptor in pieces.
///
/// Each set leaves some descriptors unchanged. A changed one is stalled, cut, extended, filled with
/// random bytes, has bits flipped, or has single bytes set to values that are critical in length
/// and count fields: 0, 1, 2, 0x7F, 0x80, 0xFF.
class DescriptorMutations {
 public:
  /// @param seed of the corpus. @param set number within it.
  DescriptorMutations(std::uint64_t seed, std::uint64_t set) noexcept : seed_(seed), set_(set) {}

  /// @param type, index, interface of GET_DESCRIPTOR: which descriptor it is.
  /// @param bytes all of the descriptor.
  /// @returns what the device answers instead; nothing for a STALL.
  [[nodiscard]] std::optional<std::vector<std::uint8_t>> apply(
      std::uint8_t type, std::uint8_t index, std::uint16_t interface,
      std::vector<std::uint8_t> bytes) const;

 private:
  std::uint64_t seed_;
  std::uint64_t set_;
};

}  // namespace forcegrid::emulator
