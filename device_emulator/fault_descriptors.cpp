// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/fault_descriptors.h"

#include <algorithm>
#include <array>
#include <random>

namespace forcegrid::emulator {

namespace {

constexpr std::array<std::uint8_t, 6> kFeared = {0x00, 0x01, 0x02, 0x7F, 0x80, 0xFF};
constexpr std::size_t kMostExtraBytes = 64;

}  // namespace

std::optional<std::vector<std::uint8_t>> DescriptorMutations::apply(
    std::uint8_t type, std::uint8_t index, std::uint16_t interface,
    std::vector<std::uint8_t> bytes) const {
  std::seed_seq sequence{static_cast<std::uint32_t>(seed_),
                         static_cast<std::uint32_t>(seed_ >> 32),
                         static_cast<std::uint32_t>(set_),
                         static_cast<std::uint32_t>(set_ >> 32),
                         std::uint32_t{type},
                         std::uint32_t{index},
                         std::uint32_t{interface}};
  std::mt19937_64 random(sequence);
  const auto below = [&random](std::size_t limit) {
    return static_cast<std::size_t>(random() % limit);
  };
  const auto any_byte = [&random] { return static_cast<std::uint8_t>(random() & 0xFFU); };

  // Otherwise hardly any set would get past its first descriptor.
  if (below(3) != 0) {
    return bytes;
  }
  const std::size_t rounds = 1 + below(3);
  for (std::size_t round = 0; round < rounds; ++round) {
    const std::size_t kind = below(20);
    if (kind == 0) {
      return std::nullopt;
    }
    if (kind == 1) {
      bytes.resize(below(bytes.size() + 1));
    } else if (kind == 2) {
      std::generate_n(std::back_inserter(bytes), 1 + below(kMostExtraBytes), any_byte);
    } else if (kind == 3) {
      std::generate(bytes.begin(), bytes.end(), any_byte);
    } else if (!bytes.empty()) {
      std::uint8_t& byte = bytes[below(bytes.size())];
      if (kind < 8) {
        byte = any_byte();
      } else if (kind < 14) {
        byte = kFeared[below(kFeared.size())];
      } else if (kind < 18) {
        byte = static_cast<std::uint8_t>(byte ^ (1U << below(8)));
      } else {
        bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(below(bytes.size())));
      }
    }
  }
  return bytes;
}

}  // namespace forcegrid::emulator
