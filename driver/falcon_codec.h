// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace forcegrid::driver::falcon {

inline constexpr std::size_t kPacketBytes = 16;
inline constexpr std::uint8_t kAllHomed = 0b111;

using PacketBytes = std::array<std::uint8_t, kPacketBytes>;

/// Lamps on the front, as bits of a packet to the device.
enum Led : std::uint8_t { kLedGreen = 0x02, kLedBlue = 0x04, kLedRed = 0x08 };

/// What goes to the device: motors 1 (top), 2 (right), 3 (left), clockwise seen from the front.
struct OutPacket {
  std::array<std::int16_t, 3> command{};  ///< positive drives the arm toward smaller angles
  std::uint8_t leds = 0;                  ///< Led bits
  bool homing = true;  ///< must stay set for the device's homing flags to stay set
};

/// What comes from the device.
struct InPacket {
  std::array<std::int16_t, 3> counts{};  ///< relative to anywhere until the axis is homed
  std::uint8_t buttons = 0;              ///< bit 0 plus (far right), 1 forward, 2 centre, 3 minus
  std::uint8_t homed = 0;                ///< bit i: counter i is absolute
};

/// 16 bytes: '<', three values of four nibbles each (least significant first, 0x41 + nibble),
/// flags, an unused byte, '>'. Real-time: bounded, no allocation, lock or throw.
[[nodiscard]] PacketBytes encode(const OutPacket& packet) noexcept;

/// Finds packets in the bytes of a serial line. Between '<' and '>' no byte of a valid packet is
/// below 0x41, so a packet that is cut short or mixed with noise can't hide the next '<'; what does
/// not fit is skipped byte by byte up to the next '<'.
/// Source: device fact sheet, section 5. Real-time: as encode(). Threads: one.
class PacketParser {
 public:
  /// Takes one byte.
  /// @returns true when it completes a packet, which is then in `packet`.
  [[nodiscard]] bool take(std::uint8_t byte, InPacket& packet) noexcept;

  /// Bytes that belonged to no packet, since the start.
  std::uint64_t skipped_bytes() const noexcept { return skipped_bytes_; }

  /// Forgets an unfinished packet.
  void reset() noexcept { size_ = 0; }

 private:
  void skip_to_next_start() noexcept;

  PacketBytes bytes_{};
  std::size_t size_ = 0;
  std::uint64_t skipped_bytes_ = 0;
};

/// Motor commands for joint torques.
struct Commands {
  bool finite = true;   ///< false: an input was NaN or infinite, and all three are zero
  bool scaled = false;  ///< the largest was beyond the limit; all three were scaled alike
  std::array<std::int16_t, 3> command{};
};

/// command_i = -gain tau_i, all three scaled by one factor so that the largest is at most `limit`
/// (the force keeps its direction), then truncated toward zero. In double until the end.
/// @param gain_per_Nm  command units for one newton metre at the joint, positive.
/// @param limit  largest command, 1 to 32767.
/// Real-time: as encode().
[[nodiscard]] Commands commands_for_torque(const std::array<double, 3>& joint_torque_Nm,
                                           double gain_per_Nm, int limit) noexcept;

}  // namespace forcegrid::driver::falcon
