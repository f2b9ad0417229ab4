#pragma once

#include <cstddef>
#include <cstdlib>
#include <string>
#include <vector>

#include "link/wire.h"

/// The worked examples of docs/link_protocol.md. The bytes were made with Python's struct and zlib
/// from the values below, not with the encoder under test.
namespace forcegrid::link::worked {

inline constexpr std::uint64_t kSession = 0x1122334455667788;

inline constexpr const char* kToolStateHex =
    "46 47 52 44 01 00 01 00 38 00 00 00 07 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 bf "
    "2d f3 55 ed ";
inline constexpr const char* kQueryHex =
    "46 47 52 44 01 00 02 00 20 00 00 00 09 00 00 00 "
    "88 77 66 55 44 33 22 11 80 b3 86 59 00 00 00 00 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 b0 3f 4d 48 b0 a9 ";
inline constexpr const char* kForceSampleHex =
    "46 47 52 44 01 00 03 00 b8 00 00 00 03 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "07 00 00 00 00 00 00 00 02 00 00 00 07 00 00 00 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 f8 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 02 40 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 50 3f "
    "00 00 00 00 00 00 90 3f 00 00 00 00 00 00 59 c0 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 59 c0 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 52 c0 "
    "dd 10 10 72 ";
inline constexpr const char* kGoodbyeHex =
    "46 47 52 44 01 00 04 00 00 00 00 00 00 00 00 00 "
    "88 77 66 55 44 33 22 11 10 c8 7b fb ";

inline ToolState tool_state() {
  return {.sequence = 7,
          .servo_time_ns = 1'500'000'000,
          .position_W_m = {0.125, -0.0625, 0.03125},
          .velocity_W_m_per_s = {0.5, 0.0, -0.25}};
}

inline Query query() {
  return {.query_id = 9, .servo_time_ns = 1'502'000'000, .position_W_m = {0.125, -0.0625, 0.0625}};
}

inline ForceSample force_sample() {
  return {.sequence = 3,
          .echo_sequence = 7,
          .echo_servo_time_ns = 1'500'000'000,
          .query_id = 0,
          .contact_epoch = 2,
          .in_contact = true,
          .converged = true,
          .has_stiffness = true,
          .position_W_m = {0.125, -0.0625, 0.03125},
          .force_W_N = {-1.5, 0.0, 2.25},
          .stiffness_W_N_per_m = {-100.0, 0.0, 0.0, 0.0, -100.0, 0.0, 0.0, 0.0, -72.0},
          .contact_point_W_m = {0.125, -0.0625, 0.0},
          .relative_residual = 0.0009765625,
          .solve_time_s = 0.015625};
}

/// "46 47 " -> {0x46, 0x47}
inline std::vector<std::byte> from_hex(const std::string& text) {
  std::vector<std::byte> bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::byte>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

}  // namespace forcegrid::link::worked
