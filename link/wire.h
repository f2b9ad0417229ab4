// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <variant>

#include "link/messages.h"
#include "link/surface_patch.h"

/// The datagrams of the link, to the byte; docs/link_protocol.md has the same as tables.
///
/// header (24 bytes) | payload (fixed size for each type) | CRC-32 of all bytes before it (4 bytes)
///
/// All numbers are little-endian; reals are IEEE 754 doubles, in a surface patch also floats.
namespace forcegrid::link {
#pragma GCC visibility push(default)

/// Of a link that names no tool: its servo has the only one.
inline constexpr std::uint16_t kProtocolVersion = 1;
/// Of a link that names its tool in each datagram.
inline constexpr std::uint16_t kToolsVersion = 2;
/// Of a link that tells poses and torques; it may name its tool.
inline constexpr std::uint16_t kPoseVersion = 3;
/// Of a link that tells sensitivities, too; it may name its tool.
inline constexpr std::uint16_t kSensitivitiesVersion = 4;

inline constexpr std::size_t kHeaderBytes = 24;
inline constexpr std::size_t kChecksumBytes = 4;
inline constexpr std::size_t kToolStateBytes = kHeaderBytes + 56 + kChecksumBytes;
inline constexpr std::size_t kQueryBytes = kHeaderBytes + 32 + kChecksumBytes;
inline constexpr std::size_t kForceSampleBytes = kHeaderBytes + 184 + kChecksumBytes;
inline constexpr std::size_t kGoodbyeBytes = kHeaderBytes + kChecksumBytes;
inline constexpr std::size_t kSurfacePatchBytes = kHeaderBytes + 385 + kChecksumBytes;
inline constexpr std::size_t kOtherToolsBytes = kHeaderBytes + 128 + kChecksumBytes;
inline constexpr std::size_t kRefusalBytes = kHeaderBytes + 8 + kChecksumBytes;
inline constexpr std::size_t kPoseToolStateBytes = kHeaderBytes + 120 + kChecksumBytes;
inline constexpr std::size_t kPoseForceSampleBytes = kHeaderBytes + 312 + kChecksumBytes;
inline constexpr std::size_t kSensitivitiesForceSampleBytes = kHeaderBytes + 700 + kChecksumBytes;
/// No datagram is longer; it fits every path without fragmentation.
inline constexpr std::size_t kMaxDatagramBytes = 1023;
/// Nor one of versions 1 to 3.
inline constexpr std::size_t kMaxOlderDatagramBytes = 511;
static_assert(kPoseForceSampleBytes <= kMaxOlderDatagramBytes);
static_assert(kSensitivitiesForceSampleBytes <= kMaxDatagramBytes);

/// Bounds of what is believed, both ways; each holds for the absolute value of every component.
inline constexpr double kMaxPosition_m = 10.0;
inline constexpr double kMaxVelocity_m_per_s = 100.0;
inline constexpr double kMaxForce_N = 1000.0;
inline constexpr double kMaxStiffness_N_per_m = 1e7;
inline constexpr double kMaxSolveTime_s = 3600.0;  ///< and not below zero
inline constexpr double kMaxAngularVelocity_rad_per_s = 1000.0;
inline constexpr double kMaxTorque_Nm = 1000.0;
inline constexpr double kMaxRotationalStiffness_Nm_per_rad = 1e7;
inline constexpr double kMaxTorqueGradient_N = 1e7;
/// How far the sum of a unit quaternion's squares may be from 1.
inline constexpr double kMaxNormError = 1e-6;

enum class MessageType : std::uint16_t {
  kToolState = 1,
  kQuery = 2,
  kForceSample = 3,
  kGoodbye = 4,
  kSurfacePatch = 5,
  kOtherTools = 6,  ///< only with a tool's number
  kRefusal = 7,     ///< only with a tool's number
};

/// What is wrong with a datagram, in the order in which it is checked.
enum class WireStatus : std::uint8_t {
  kOk,
  kTooShort,     ///< no room for header and checksum
  kBadMagic,     ///< does not start with "FGRD"
  kBadVersion,   ///< another version of the protocol
  kBadType,      ///< no such message type
  kBadLength,    ///< datagram or its length field differ from the type's fixed size
  kBadChecksum,  ///< corrupted on its way
  kBadReserved,  ///< a reserved field, an unknown flag or something undeclared is not zero
  kNotFinite,    ///< NaN or infinity
  /// Beyond the bounds above, time or residual below zero, session or query id 0, a triangle with a
  /// missing vertex, a quaternion that is not a unit one, a tool above kMaxToolId, or in version 2
  /// the tool 0.
  kOutOfRange,
};
inline constexpr std::size_t kWireStatusCount = 10;

/// Static text in lower case, e.g. "bad checksum".
const char* to_string(WireStatus status) noexcept;

/// Either side to the other: this end stops now; don't wait for a time-out.
struct Goodbye {
  /// Of a servo with a tool's number: its device has failed. Without a number it is not carried.
  bool fault = false;
};

/// A checked datagram. Unless `status` is kOk the message is std::monostate and `session_id` 0.
struct Decoded {
  WireStatus status = WireStatus::kTooShort;
  std::uint64_t session_id = 0;
  std::variant<std::monostate, ToolState, Query, ForceSample, Goodbye, SurfacePatch, OtherTools,
               Refusal>
      message;
  ToolId tool = 0;                       ///< 0: the datagram names no tool
  Content content = Content::kPosition;  ///< of the datagram's version
};

/// Checks a received datagram completely and reads it. Safe for any bytes of any length.
/// Real-time: bounded, no allocation, lock or throw. Threads: any.
[[nodiscard]] Decoded decode(std::span<const std::byte> datagram) noexcept;

/// `size_bytes` is 0 unless `status` is kOk.
struct Encoded {
  WireStatus status = WireStatus::kOutOfRange;
  std::size_t size_bytes = 0;
};

/// Writes `message` to the front of `buffer`. Refuses what decode() would refuse, so that a fault
/// shows on the side that made it; kTooShort means that the buffer is too small.
/// @param session_id  the servo's number for this run, not zero
/// @param tool  0 names no tool
/// @param content  kPosition writes version 1, or 2 with a tool's number; kPose writes version 3,
///   kSensitivities version 4
/// Real-time: bounded, no allocation, lock or throw. Threads: any.
[[nodiscard]] Encoded encode(const ToolState& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool = 0,
                             Content content = Content::kPosition) noexcept;
[[nodiscard]] Encoded encode(const Query& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool = 0,
                             Content content = Content::kPosition) noexcept;
[[nodiscard]] Encoded encode(const ForceSample& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool = 0,
                             Content content = Content::kPosition) noexcept;
[[nodiscard]] Encoded encode(const Goodbye& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool = 0,
                             Content content = Content::kPosition) noexcept;
[[nodiscard]] Encoded encode(const SurfacePatch& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool = 0,
                             Content content = Content::kPosition) noexcept;
/// With `tool` 0 these are refused: they are for servos with a tool's number.
[[nodiscard]] Encoded encode(const OtherTools& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool,
                             Content content = Content::kPosition) noexcept;
[[nodiscard]] Encoded encode(const Refusal& message, std::uint64_t session_id,
                             std::span<std::byte> buffer, ToolId tool,
                             Content content = Content::kPosition) noexcept;

#pragma GCC visibility pop
}  // namespace forcegrid::link
