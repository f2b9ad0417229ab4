// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace forcegrid::firmware {

/// A recorded trace as the player on the processor reads it, and its answers: structures of the
/// same layout on both sides, little-endian.
enum class RecordKind : std::uint32_t { kContactMade = 1, kContactLost, kSample, kCycle };

/// One thing that happens, in order of its arrival.
struct TraceRecord {
  RecordKind kind = RecordKind::kCycle;
  std::uint32_t epoch = 0;               ///< of a contact or a sample
  double time_s = 0.0;                   ///< of a sample or a cycle
  std::array<double, 3> position_W{};    ///< [m] of a sample; the point of a contact
  std::array<double, 3> force_W{};       ///< [N] of a sample
  std::array<std::int32_t, 6> counts{};  ///< encoders, of a cycle
};
static_assert(sizeof(TraceRecord) == 88);

/// What one cycle found and did.
struct CycleAnswer {
  std::uint32_t pose_status = 0;             ///< driver::KinematicsStatus
  std::uint32_t estimate_status = 0;         ///< EstimateStatus
  std::array<std::int32_t, 4> current_mA{};  ///< a, b, c, and zero
  std::array<double, 3> position_D{};        ///< [m]
  std::array<double, 9> jacobian_D{};        ///< [m/rad] column by column
  std::array<double, 3> force_D{};           ///< [N] the method's
};
static_assert(sizeof(CycleAnswer) == 144);

}  // namespace forcegrid::firmware
