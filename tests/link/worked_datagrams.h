// SPDX-License-Identifier: Apache-2.0
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

inline constexpr const char* kSurfacePatchHex =
    "46 47 52 44 01 00 05 00 81 01 00 00 04 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "07 00 00 00 02 00 00 00 04 02 01 00 00 00 00 3c "
    "00 00 00 00 00 00 c8 c2 00 00 c8 c2 00 00 90 c2 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 c0 3f 00 00 00 00 00 00 b0 bf 00 00 00 00 "
    "00 00 a0 3f 00 00 00 bc 00 00 00 bc 00 00 00 bc "
    "00 00 00 3c 00 00 00 bc 00 00 00 bc 00 00 00 3c "
    "00 00 00 3c 00 00 00 bc 00 00 00 bc 00 00 00 3c "
    "00 00 00 bc 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 01 02 00 02 03 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 e4 4c d2 12 ";

inline constexpr const char* kSlidingPatchHex =
    "46 47 52 44 01 00 05 00 81 01 00 00 05 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "07 00 00 00 02 00 00 00 04 02 02 46 00 00 00 3c "
    "00 00 00 3d 00 00 80 be 00 00 00 00 00 00 80 3f "
    "00 00 40 bf 00 00 00 00 00 00 40 40 00 00 00 00 "
    "00 00 c0 3f 00 00 00 00 00 00 b0 bf 00 00 00 00 "
    "00 00 a0 3f 00 00 00 bc 00 00 00 bc 00 00 00 bc "
    "00 00 00 3c 00 00 00 bc 00 00 00 bc 00 00 00 3c "
    "00 00 00 3c 00 00 00 bc 00 00 00 bc 00 00 00 3c "
    "00 00 00 bc 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 01 02 00 02 03 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 cc e4 01 4f ";

// Of version 2, for tool 2.
inline constexpr const char* kTool2StateHex =
    "46 47 52 44 02 00 01 00 38 00 02 00 07 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 bf "
    "f8 56 2f 16 ";
inline constexpr const char* kOtherToolsHex =
    "46 47 52 44 02 00 06 00 80 00 02 00 05 00 00 00 "
    "88 77 66 55 44 33 22 11 02 00 00 00 00 00 00 00 "
    "01 00 01 00 00 00 00 00 50 d6 dc 01 00 00 00 00 "
    "00 00 00 00 00 00 b0 3f 00 00 00 00 00 00 c0 3f "
    "00 00 00 00 00 00 90 bf 00 00 00 00 00 00 00 00 "
    "80 84 1e 00 00 00 00 00 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 3f ec da ed ";
inline constexpr const char* kRefusalHex =
    "46 47 52 44 02 00 07 00 08 00 02 00 00 00 00 00 "
    "88 77 66 55 44 33 22 11 02 00 00 00 04 00 00 00 "
    "2b 2c f9 79 ";

// Of version 3, for the only tool and for tool 2.
inline constexpr const char* kPoseToolStateHex =
    "46 47 52 44 03 00 01 00 78 00 00 00 07 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 e0 bf 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 d0 3f 00 00 00 00 00 00 00 c0 "
    "00 00 00 00 00 00 00 00 05 00 00 00 03 00 00 00 "
    "5d f5 c4 4f ";
inline constexpr const char* kPoseTool2StateHex =
    "46 47 52 44 03 00 01 00 78 00 02 00 07 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "00 00 00 00 00 00 c0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 e0 bf 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 d0 3f 00 00 00 00 00 00 00 c0 "
    "00 00 00 00 00 00 00 00 05 00 00 00 03 00 00 00 "
    "30 1d 90 60 ";
inline constexpr const char* kPoseForceSampleHex =
    "46 47 52 44 03 00 03 00 38 01 00 00 03 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "07 00 00 00 00 00 00 00 02 00 00 00 1f 00 00 00 "
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
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 e0 bf "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 c0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 c0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 e0 bf "
    "f1 92 a6 1d ";

// Of version 4, for tool 2.
inline constexpr const char* kSensitivitiesForceSampleHex =
    "46 47 52 44 04 00 03 00 bc 02 02 00 03 00 00 00 "
    "88 77 66 55 44 33 22 11 00 2f 68 59 00 00 00 00 "
    "07 00 00 00 00 00 00 00 02 00 00 00 3f 00 00 00 "
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
    "00 00 00 00 00 00 a0 3f 00 00 00 00 00 00 b0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 e0 3f "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 e0 bf "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 c0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 c0 3f "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 e0 bf "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 40 "
    "00 00 00 00 00 00 e0 bf 00 00 00 00 00 00 00 c0 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 d0 3f "
    "00 00 00 00 00 00 e0 3f 00 00 00 00 00 00 d0 bf "
    "00 00 00 00 00 00 c0 3f 01 00 00 00 01 00 00 00 "
    "06 00 00 00 00 00 00 00 00 00 b0 3f 00 00 00 00 "
    "00 00 c0 3f 00 00 00 00 00 00 90 bf 00 00 00 00 "
    "00 00 20 40 00 00 00 00 00 00 f0 3f 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 c0 00 00 00 00 "
    "00 00 30 40 00 00 00 00 00 00 e0 3f 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 d0 3f 00 00 00 00 "
    "00 00 10 40 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
    "00 00 00 00 61 e1 60 df ";

// Sealed with libsodium through PyNaCl, the key's id with Python's hashlib: the tool state above,
// and a hello that answers it.
inline constexpr const char* kSealedToolStateHex =
    "46 47 52 53 01 00 01 00 0a f9 4c aa c9 2e 9c d0 "
    "20 21 22 23 24 25 26 27 28 29 2a 2b 2c 2d 2e 2f "
    "05 00 00 00 00 00 00 00 30 31 32 33 34 35 36 37 "
    "38 39 3a 3b 3c 3d 3e 3f 6e be 3c 7b 8f b1 6e 23 "
    "1c 19 5b 30 26 22 50 23 f9 f7 9b 44 21 d8 34 4f "
    "b7 dc 6f 17 59 f8 1a 00 0a 0f fd b5 f0 61 28 a2 "
    "4a 61 67 7f 94 13 65 be 73 e1 84 02 5f e2 eb 9c "
    "5a 24 d3 ea bc 49 f8 1c d7 ab d0 c4 dd 6d 4e bd "
    "a1 2b 90 46 bc 2c 57 32 16 02 0f 3b a0 ab dd 06 "
    "0a ae 06 fa c0 c0 f3 d2 8d 00 e8 ce 8b 50 a3 f5 "
    "91 09 98 e3 6f c5 78 7e 66 ca 89 d8 d0 74 94 3e "
    "98 36 b5 44 ";
inline constexpr const char* kHelloHex =
    "46 47 52 53 01 00 02 00 0a f9 4c aa c9 2e 9c d0 "
    "30 31 32 33 34 35 36 37 38 39 3a 3b 3c 3d 3e 3f "
    "01 00 00 00 00 00 00 00 20 21 22 23 24 25 26 27 "
    "28 29 2a 2b 2c 2d 2e 2f 15 22 16 b5 cd 28 90 09 "
    "6f fd 66 50 91 08 88 68 87 05 f4 0b 9e b4 53 24 "
    "6c 4b bd c1 2d f7 a5 60 95 45 5a 18 1f 63 07 0e ";

inline ToolState tool_state() {
  return {.sequence = 7,
          .servo_time_ns = 1'500'000'000,
          .position_W_m = {0.125, -0.0625, 0.03125},
          .velocity_W_m_per_s = {0.5, 0.0, -0.25}};
}

/// The same of a device with a wrist: turned by 120 degrees about (1, -1, 1).
inline ToolState pose_tool_state() {
  ToolState state = tool_state();
  state.has_orientation = true;
  state.has_buttons = true;
  state.orientation_WT = {0.5, 0.5, -0.5, 0.5};
  state.angular_velocity_W_rad_per_s = {0.25, -2.0, 0.0};
  state.buttons = 5;
  return state;
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

inline ForceSample pose_force_sample() {
  ForceSample sample = force_sample();
  sample.has_torque = true;
  sample.has_rotational_stiffness = true;
  sample.torque_W_Nm = {0.03125, -0.0625, 0.0};
  sample.orientation_WT = {0.5, 0.5, -0.5, 0.5};
  sample.rotational_stiffness_W_Nm_per_rad = {-0.25, 0.0, 0.125, 0.0, -0.25, 0.0, 0.125, 0.0, -0.5};
  return sample;
}

/// The same with what version 4 adds: a gradient, and tool 1 beside it.
inline ForceSample sensitivities_force_sample() {
  ForceSample sample = pose_force_sample();
  sample.has_torque_gradient = true;
  sample.torque_gradient_W_N = {0.0, 2.0, -0.5, -2.0, 0.0, 0.25, 0.5, -0.25, 0.125};
  sample.influence_count = 1;
  sample.influences[0] = {.tool = 1,
                          .echo_sequence = 6,
                          .position_W_m = {0.0625, 0.125, -0.015625},
                          .stiffness_W_N_per_m = {8.0, 1.0, 0.0, -2.0, 16.0, 0.5, 0.0, 0.25, 4.0}};
  return sample;
}

inline SurfacePatch surface_patch() {
  constexpr float kSide_m = 0.0078125F;
  SurfacePatch patch;
  patch.sequence = 4;
  patch.echo_sequence = 7;
  patch.echo_servo_time_ns = 1'500'000'000;
  patch.contact_epoch = 2;
  patch.has_stiffness = true;
  patch.vertex_count = 4;
  patch.triangle_count = 2;
  patch.tool_radius_m = kSide_m;
  patch.stiffness_W_N_per_m = {-100.0F, -100.0F, -72.0F, 0.0F, 0.0F, 0.0F};
  patch.position_W_m = {0.125, -0.0625, 0.03125};
  patch.vertices_W_m[0] = {-kSide_m, -kSide_m, -kSide_m};
  patch.vertices_W_m[1] = {kSide_m, -kSide_m, -kSide_m};
  patch.vertices_W_m[2] = {kSide_m, kSide_m, -kSide_m};
  patch.vertices_W_m[3] = {-kSide_m, kSide_m, -kSide_m};
  patch.triangles[0] = {0, 1, 2};
  patch.triangles[1] = {0, 2, 3};
  return patch;
}

/// The same square below a grasper that presses and slides.
inline SurfacePatch sliding_patch() {
  SurfacePatch patch = surface_patch();
  patch.sequence = 5;
  patch.has_stiffness = false;
  patch.stiffness_W_N_per_m = {};
  patch.has_press_forces = true;
  patch.press_forces_W_N = {{{-0.25F, 0.0F, 1.0F}, {-0.75F, 0.0F, 3.0F}}};
  patch.tool_length_m = 0.03125F;
  patch.tool_opening_crad = 70;
  return patch;
}

inline OtherTools other_tools() {
  OtherTools others;
  others.sequence = 5;
  others.count = 2;
  others.tools[0] = {.tool = 1,
                     .in_contact = true,
                     .age_ns = 31'250'000,
                     .position_W_m = {0.0625, 0.125, -0.015625}};
  others.tools[1] = {
      .tool = 0, .in_contact = false, .age_ns = 2'000'000, .position_W_m = {-0.0625, 0.0, 0.25}};
  return others;
}

inline Refusal refusal() { return {.reason = Refusal::Reason::kToolTaken, .most_tools = 4}; }

/// "46 47 " -> {0x46, 0x47}
inline std::vector<std::byte> from_hex(const std::string& text) {
  std::vector<std::byte> bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::byte>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

}  // namespace forcegrid::link::worked
