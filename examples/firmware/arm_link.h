// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "examples/firmware/serial_frames.h"

namespace forcegrid::firmware {

/// What the board with the encoders and amplifiers sends once per cycle: a frame of 32 bytes,
/// little-endian.
///
///   offset  type    field
///   0       u32     number of the cycle, rises by one
///   4       6 i32   encoder counters
///   28      u32     CRC-32 of the bytes before it
struct ArmState {
  static constexpr std::size_t kBytes = 32;
  std::uint32_t number = 0;
  std::array<std::int32_t, 6> counts{};
};

/// The answer, a frame of 16 bytes:
///
///   0       u32     number of the cycle that it answers; 0, once at start: ready
///   4       3 i16   currents of the motors a, b, c [mA]
///   10      u8      driver::KinematicsStatus of the pose
///   11      u8      EstimateStatus of the force
///   12      u32     CRC-32 of the bytes before it
struct ArmCommand {
  static constexpr std::size_t kBytes = 16;
  std::uint32_t number = 0;
  std::array<std::int16_t, 3> current_mA{};
  std::uint8_t pose_status = 0, estimate_status = 0;
};

/// Real-time: no allocation, lock or throw. @returns nothing for bytes that are no such frame.
inline std::optional<ArmState> arm_state_of(std::span<const std::uint8_t> frame) noexcept {
  if (frame.size() != ArmState::kBytes || get<std::uint32_t>(frame, 28) != crc32(frame.first(28))) {
    return std::nullopt;
  }
  return ArmState{get<std::uint32_t>(frame, 0), get<std::array<std::int32_t, 6>>(frame, 4)};
}

inline std::array<std::uint8_t, ArmCommand::kBytes> bytes_of(const ArmCommand& command) noexcept {
  std::array<std::uint8_t, ArmCommand::kBytes> bytes{};
  put(bytes, 0, command.number);
  put(bytes, 4, command.current_mA);
  put(bytes, 10, command.pose_status);
  put(bytes, 11, command.estimate_status);
  put(bytes, 12, crc32(std::span(bytes).first(12)));
  return bytes;
}

}  // namespace forcegrid::firmware
