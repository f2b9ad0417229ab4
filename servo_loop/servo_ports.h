// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "forcegrid/core/force_method.h"
#include "link/clock_estimate.h"
#include "link/messages.h"
#include "rt/clock.h"
#include "rt/mailbox.h"
#include "rt/spsc_ring.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/first_touch.h"

namespace forcegrid::servo {

/// [s] The servo's clock (CLOCK_MONOTONIC) as methods and samples state it.
inline double servo_time_s(rt::TimePoint time) noexcept {
  return rt::seconds(time.time_since_epoch());
}

/// How a sample's force depends on another tool that holds the same object: the force's first
/// order in that tool's position. See link::ToolInfluence.
struct ToolInfluence {
  link::ToolId tool = 0;
  /// When that tool was there, by number: its own servo's sample of the same solution has it as
  /// ArrivedSample::echo_sequence.
  std::uint32_t echo_sequence = 0;
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  /// d(force on this tool)/d(position of that one) [N/m]; in a conservative object the transpose of
  /// what that tool's sample has of this one.
  Eigen::Matrix3d stiffness_W = Eigen::Matrix3d::Zero();
};

/// A sample of the simulator on its way from the link thread to the servo.
struct ArrivedSample {
  Sample sample;
  bool in_contact = false;          ///< whether the tool touched the object
  rt::TimePoint arrived{};          ///< when the link thread received it
  std::uint32_t echo_sequence = 0;  ///< number of the tool state that it answers; 0 of a query's
  // Of a simulator that knows how the tool is turned; see link::ForceSample.
  bool has_torque = false;
  bool has_rotational_stiffness = false;
  Eigen::Vector3d torque_W_Nm = Eigen::Vector3d::Zero();  ///< on the tool, about sample.position_W
  std::array<double, 4> orientation_WT_wxyz = link::kIdentity;  ///< that it was computed for
  /// d(torque)/d(theta) at a fixed position.
  Eigen::Matrix3d rotational_stiffness_W_Nm_per_rad = Eigen::Matrix3d::Zero();
  // Of a simulator that knows sensitivities.
  bool has_torque_gradient = false;
  Eigen::Matrix3d torque_gradient_W_N = Eigen::Matrix3d::Zero();  ///< d(torque)/dP, not turned
  std::size_t influence_count = 0;  ///< other tools in contact, of a simulator of several
  std::array<ToolInfluence, link::kMostTools - 1> influences{};  ///< the first of these
};

/// What the servo loop exchanges with other threads, all of it lock-free. The loop pops `samples`,
/// pushes `records` and `queries`, fetches `surface` and publishes `tool`.
struct ServoPorts {
  static constexpr int kSampleCapacity = 64;
  rt::SpscRing<ArrivedSample> samples{kSampleCapacity};
  rt::SpscRing<CycleRecord> records{8192};
  rt::SpscRing<link::Query> queries{64};
  rt::Mailbox<link::ToolState> tool;
  rt::Mailbox<NearSurface> surface;  ///< the surface near the tool, for FirstTouch
  /// From the link thread to telemetry: the offset of the simulator's clock, if known.
  rt::Mailbox<link::ClockEstimate> simulator_clock;
  /// From any thread: the force fades out and, once this is false again, ramps in.
  std::atomic<bool> force_paused{false};
  /// From any thread: index of the method to render, see MethodFade.
  std::atomic<std::uint8_t> rendered_method{0};
  /// From any thread: ServoOptions::requests_per_s from now on; NaN: as the options say.
  std::atomic<double> requests_per_s{std::numeric_limits<double>::quiet_NaN()};
  /// From any thread: ForceMethod::set_budget() of every method that keeps a budget; NaN: as the
  /// methods were made.
  std::atomic<double> budget_reads{std::numeric_limits<double>::quiet_NaN()};
  std::atomic<std::uint64_t> records_lost{0};  ///< records that found the ring full
};

}  // namespace forcegrid::servo
