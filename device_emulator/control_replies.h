// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "device_emulator/usb.h"

/// Answers to control transfers that the emulated devices share.
namespace forcegrid::emulator {

inline std::uint8_t low_byte(std::uint16_t word) { return static_cast<std::uint8_t>(word & 0xFFU); }
inline std::uint8_t high_byte(std::uint16_t word) { return static_cast<std::uint8_t>(word >> 8); }

/// The request is not known, or not with these values.
inline ControlReply stall() { return {}; }
/// Success without data.
inline ControlReply done() { return {false, {}}; }
/// Success with two bytes, the lower one first.
inline ControlReply word_reply(std::uint16_t value) {
  return {false, {low_byte(value), high_byte(value)}};
}

}  // namespace forcegrid::emulator
