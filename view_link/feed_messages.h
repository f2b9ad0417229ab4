// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace forcegrid::view_link {

/// Types of the frames between `forcegrid run` and the live view.
enum class FeedType : std::uint16_t {
  kHello = 1,         ///< JSON, the first frame: what runs
  kCycles = 2,        ///< FeedCycle, one or more, every servo cycle in order
  kSamples = 3,       ///< FeedSample, one or more
  kArm = 4,           ///< the arm's links as lines
  kNote = 5,          ///< JSON: a sentence for people
  kAcknowledged = 6,  ///< JSON: what became of a command
  kEnd = 7,           ///< JSON: how the run ended
  kPlayback = 8,      ///< JSON, of a recording: where its player is
  kSettings = 9,      ///< JSON: what can be changed while it runs, and how it stands
  kCommand = 16,      ///< JSON, from the view: what the person wants
};
inline constexpr std::size_t kLargestCommand = 4096;  ///< [bytes] of a command's JSON

inline constexpr std::size_t kFeedMethods = 4;

/// One servo cycle, all of it in the workspace frame W. Without gaps, so that it goes over the
/// socket as it is in memory, little-endian.
struct FeedCycle {
  std::uint64_t cycle = 0;
  std::int64_t time_ns = 0;          ///< CLOCK_MONOTONIC at the start of the cycle
  std::uint64_t arrivals_taken = 0;  ///< samples and answers, since the start
  std::array<double, 3> position_W_m{};
  std::array<double, 3> touching_W_m{};  ///< where the methods were asked
  std::array<double, 3> velocity_W_m_per_s{};
  std::array<std::array<double, 3>, kFeedMethods> method_force_W_N{};  ///< before any limit
  std::array<double, kFeedMethods> method_uncertainty_N{};             ///< NaN: it can't tell
  std::array<double, 3> commanded_force_W_N{};                         ///< after every limit
  double period_us = 0.0;
  double wakeup_us = 0.0;
  double compute_us = 0.0;
  double report_age_us = 0.0;
  double sample_age_ms = 0.0;  ///< -1: no sample
  double gain = 0.0;           ///< of ramp and fade, 0..1
  double damping_gain = 0.0;
  double energy_to_hand_J = 0.0;
  double passivity_scale = 1.0;
  double motor_warmth = 0.0;
  double sample_period_ms = 0.0;  ///< from sample to sample, averaged over some ten of them
  double requests_per_s = 0.0;    ///< that the rendered method may make
  double budget_reads = 0.0;      ///< of a cycle; infinite: no limit; NaN: as the methods were made
  std::uint32_t contact_epoch = 0;
  std::uint32_t missed_deadlines = 0;  ///< since the cycle before
  std::array<std::uint8_t, kFeedMethods> method_status{};
  std::uint8_t rendered_candidate = 0;
  std::uint8_t rendered_reason = 0;
  std::uint8_t rung = 0;
  std::uint8_t held_back = 0;
  std::uint8_t limits_acted = 0;  ///< bits
  std::uint8_t in_contact = 0;
  std::uint8_t fault = 0;
  std::uint8_t paused = 0;           ///< the person has paused the force
  std::uint8_t rendered_method = 0;  ///< the one that is rendered, or faded to
  std::array<std::uint8_t, 3> reserved{};
};
static_assert(std::is_trivially_copyable_v<FeedCycle>);
static_assert(sizeof(FeedCycle) == 3 * 8 + 9 * 8 + 12 * 8 + 4 * 8 + 3 * 8 + 13 * 8 + 2 * 4 + 16);

/// A sample of the simulator, in the workspace frame W.
struct FeedSample {
  std::int64_t arrived_ns = 0;  ///< CLOCK_MONOTONIC
  double time_s = 0.0;          ///< servo's clock when the tool was there
  std::array<double, 3> position_W_m{};
  std::array<double, 3> force_W_N{};
  std::array<double, 3> contact_point_W_m{};
  std::array<double, 9> stiffness_W_N_per_m{};  ///< by rows; valid with has_stiffness
  std::uint32_t contact_epoch = 0;
  std::uint8_t in_contact = 0;
  std::uint8_t has_stiffness = 0;
  std::uint8_t requested = 0;  ///< an answer to a request, not to the tool's own position
  std::uint8_t converged = 1;
  double relative_residual = 0.0;
};
static_assert(std::is_trivially_copyable_v<FeedSample>);
static_assert(sizeof(FeedSample) == 2 * 8 + 9 * 8 + 9 * 8 + 2 * 8);

}  // namespace forcegrid::view_link
