// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_codec.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::driver::falcon {
namespace {

constexpr std::uint8_t kStart = 0x3C;  // '<'
constexpr std::uint8_t kEnd = 0x3E;    // '>'
constexpr std::uint8_t kZero = 0x41;   // 'A'
constexpr std::size_t kFlagsAt = 13;
constexpr std::uint8_t kHomingBit = 0x01;
constexpr std::uint8_t kLargestInFlags = 0x7F;

void put_value(std::uint8_t* digits, std::int16_t value) noexcept {
  auto rest = static_cast<std::uint16_t>(value);
  for (int i = 0; i < 4; ++i, rest = static_cast<std::uint16_t>(rest >> 4)) {
    digits[i] = static_cast<std::uint8_t>(kZero + (rest & 0xF));
  }
}

std::int16_t value_of(const std::uint8_t* digits) noexcept {
  unsigned value = 0;
  for (int i = 3; i >= 0; --i) {
    value = (value << 4) | static_cast<unsigned>(digits[i] - kZero);
  }
  return static_cast<std::int16_t>(static_cast<std::uint16_t>(value));
}

/// Whether `byte` may stand at place `at` of a packet from the device.
bool fits(std::uint8_t byte, std::size_t at) noexcept {
  if (at == 0) {
    return byte == kStart;
  }
  if (at == kPacketBytes - 1) {
    return byte == kEnd;
  }
  if (at < kFlagsAt) {
    return byte >= kZero && byte <= kZero + 0xF;
  }
  if (at == kFlagsAt) {
    return byte >= kZero && byte <= kZero + kLargestInFlags;
  }
  return byte >= kZero;  // unused, but never a delimiter
}

}  // namespace

PacketBytes encode(const OutPacket& packet) noexcept {
  PacketBytes bytes;
  bytes.front() = kStart;
  for (std::size_t motor = 0; motor < 3; ++motor) {
    put_value(&bytes[1 + 4 * motor], packet.command[motor]);
  }
  bytes[kFlagsAt] =
      static_cast<std::uint8_t>(kZero + (packet.leds | (packet.homing ? kHomingBit : 0)));
  bytes[kFlagsAt + 1] = kZero;
  bytes.back() = kEnd;
  return bytes;
}

bool PacketParser::take(std::uint8_t byte, InPacket& packet) noexcept {
  bytes_[size_++] = byte;
  if (!fits(byte, size_ - 1)) {
    skip_to_next_start();
    return false;
  }
  if (size_ < kPacketBytes) {
    return false;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    packet.counts[axis] = value_of(&bytes_[1 + 4 * axis]);
  }
  const auto flags = static_cast<unsigned>(bytes_[kFlagsAt] - kZero);
  packet.buttons = static_cast<std::uint8_t>(flags & 0xF);
  packet.homed = static_cast<std::uint8_t>(flags >> 4);
  size_ = 0;
  return true;
}

// Only the byte that did not fit can be a start: those before it did fit, and none of them is one.
void PacketParser::skip_to_next_start() noexcept {
  const std::uint8_t last = bytes_[size_ - 1];
  const bool restarts = size_ > 1 && last == kStart;
  skipped_bytes_ += restarts ? size_ - 1 : size_;
  bytes_[0] = last;
  size_ = restarts ? 1 : 0;
}

Commands commands_for_torque(const std::array<double, 3>& joint_torque_Nm, double gain_per_Nm,
                             int limit) noexcept {
  Commands result;
  std::array<double, 3> wanted{};
  double largest = 0.0;
  for (std::size_t motor = 0; motor < 3; ++motor) {
    wanted[motor] = -gain_per_Nm * joint_torque_Nm[motor];
    if (!std::isfinite(wanted[motor])) {
      result.finite = false;
      return result;
    }
    largest = std::max(largest, std::abs(wanted[motor]));
  }
  const auto bound = static_cast<double>(limit);
  result.scaled = largest > bound;
  for (std::size_t motor = 0; motor < 3; ++motor) {
    // Divided before it is multiplied, so that a huge torque does not overflow.
    const double value = result.scaled ? wanted[motor] / largest * bound : wanted[motor];
    result.command[motor] = static_cast<std::int16_t>(std::clamp(value, -bound, bound));
  }
  return result;
}

}  // namespace forcegrid::driver::falcon
