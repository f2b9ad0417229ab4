// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "forcegrid/core/force_method.h"
#include "servo_loop/degradation_ladder.h"
#include "servo_loop/fault.h"

namespace forcegrid::servo {

/// Methods that one loop can run side by side: the rendered one, and others that are evaluated.
inline constexpr std::size_t kMaxMethods = 4;

using Triple = std::array<double, 3>;

/// What one servo cycle read and did, for telemetry and the flight record. Plain data.
struct CycleRecord {
  std::uint64_t cycle = 0;
  std::int64_t time_ns = 0;    ///< CLOCK_MONOTONIC at the start of the cycle
  double period_us = 0.0;      ///< since the start of the cycle before; 0 in the first
  double wakeup_us = 0.0;      ///< start of the cycle minus its deadline
  double compute_us = 0.0;     ///< from the start of the cycle to its end, its listener included
  double report_age_us = 0.0;  ///< start of the cycle minus completion of the OUT that released it
  std::uint64_t report_sequence = 0;
  std::array<std::int32_t, 3> counts{};
  Triple position_W_m{};
  /// Where the methods were evaluated: at the tool, or at the proxy of a virtual coupling.
  Triple touching_W_m{};
  Triple velocity_W_m_per_s{};
  /// The device has a wrist; without one the tool keeps the axes of W, and the rest is zero.
  bool has_orientation = false;
  /// Bits 0, 1, 2: encoder d, e, f has not counted for long, so that the orientation may be wrong;
  /// see WristGuard.
  std::uint8_t suspected_wrist_encoders = 0;
  std::uint8_t buttons = 0;                     ///< see driver::DeviceReport
  std::array<std::int32_t, 3> gimbal_counts{};  ///< d, e, f
  Triple gimbal_angle_rad{};                    ///< of the wrist's joints from the arm outward
  /// Unit quaternion w, x, y, z of the rotation from the tool's frame T to W; w >= 0.
  std::array<double, 4> orientation_WT_wxyz{1.0, 0.0, 0.0, 0.0};
  Triple angular_velocity_W_rad_per_s{};  ///< of T, filtered
  /// Of the object on the tool, about position_W_m, with the force that is commanded; see
  /// ToolTorque. Zero without a wrist, and of a simulator that sends no torque.
  Triple tool_torque_W_Nm{};
  std::array<Triple, kMaxMethods> method_force_W_N{};  ///< each method's own, before any limit
  std::array<EstimateStatus, kMaxMethods> method_status{};
  std::array<double, kMaxMethods> method_uncertainty_N{};  ///< NaN: it can't tell
  Triple tool_force_W_N{};  ///< of the other devices' tools on this one, before gain and limits
  std::uint8_t rendered_method = 0;     ///< index of the method that is rendered, or faded to
  std::uint8_t rendered_candidate = 0;  ///< index in the first method's candidates()
  ChoiceReason rendered_reason = ChoiceReason::kFirst;
  double gain = 0.0;          ///< ramp and fade, 0..1
  double damping_gain = 0.0;  ///< of the damping field, 0..1
  Rung rung = Rung::kZero;
  HeldBack held_back = HeldBack::kNoSamples;
  Triple commanded_force_D_N{};  ///< after ramp, fade and every limit
  Triple current_A{};
  Triple wrist_current_A{};       ///< of a wrist's motors
  std::uint8_t limits_acted = 0;  ///< driver::LimitFlag bits
  /// Energy given to the hand by the rendered force in this contact, see PassivityGuard.
  double energy_to_hand_J = 0.0;
  double passivity_damping_N_s_per_m = 0.0;  ///< that the guard added
  double passivity_scale = 1.0;              ///< by which it shortened the wanted force
  double motor_warmth = 0.0;                 ///< of the warmest, see MotorWarmth::warmest()
  bool in_contact = false;
  std::uint32_t contact_epoch = 0;
  std::uint64_t samples_taken = 0;   ///< along the path, since the start
  std::uint64_t arrivals_taken = 0;  ///< these and answers to requests
  /// Since the tool was where the newest sample was computed; -1: no sample.
  double sample_age_ms = 0.0;
  double sample_period_ms = 0.0;  ///< from sample to sample, averaged over some ten of them
  double requests_per_s = 0.0;    ///< that the rendered method may make
  /// [bare trilinear reads a cycle] Infinite: no limit; NaN: as the methods were made.
  double budget_reads = std::numeric_limits<double>::quiet_NaN();
  std::uint32_t missed_deadlines = 0;  ///< deadlines that passed unserved just before this cycle
  Fault fault = Fault::kNone;
};
static_assert(std::is_trivially_copyable_v<CycleRecord>);

}  // namespace forcegrid::servo
