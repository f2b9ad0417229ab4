// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <deque>
#include <exception>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "rt/clock.h"
#include "rt/percentiles.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/servo_loop.h"

namespace forcegrid::servo {
#pragma GCC visibility push(default)

struct TelemetryOptions {
  std::vector<std::string> method_names;  ///< in the loop's order
  double rate_Hz = 500.0;
  /// Records are taken from the loop's ring, which holds 2 s of them at 4 kHz, when this long has
  /// passed and the loop sleeps after its next cycle: what is done with them then holds up none of
  /// its wake-ups.
  std::chrono::milliseconds drain_interval{20};
  /// How many of the newest cycles are kept; older ones count only in the statistics.
  std::size_t keep_cycles = 300'000;
  /// Called once a second with the live line. Empty: there is none. As the others on the thread
  /// that drains, and with lines without a newline.
  std::function<void(const std::string&)> on_live_line;
  /// Called with a sentence and its time whenever the loop changes what it does about late forces
  /// or warm motors.
  std::function<void(const std::string&)> on_sentence;
  /// Called with every cycle, on the thread that drains; must return soon.
  std::function<void(const CycleRecord&)> on_cycle;
  /// Called behind the last of each drain's cycles, if there was one; likewise.
  std::function<void()> on_drained;
};

/// The rendered method switched to another of its candidates.
struct CandidateChange {
  double time_s = 0.0;  ///< since the first cycle
  std::uint8_t from = 0;
  std::uint8_t to = 0;
  ChoiceReason reason = ChoiceReason::kFirst;
};

/// The loop stepped from one rung of its ladder to another.
struct RungChange {
  double time_s = 0.0;  ///< since the first cycle
  Rung from = Rung::kZero;
  Rung to = Rung::kZero;
  HeldBack held_back = HeldBack::kNot;
};

/// What a device's wrist and buttons did in a run.
struct OrientationStatistics {
  bool known = false;                    ///< the device has a wrist
  std::uint64_t cycles_suspected = 0;    ///< in which one of its encoders was, see WristGuard
  std::uint8_t suspected_encoders = 0;   ///< those that have been: bits 0, 1, 2 for d, e, f
  double largest_speed_rad_per_s = 0.0;  ///< of the tool's frame
  double largest_torque_Nm = 0.0;        ///< of the object on the tool
  std::array<double, 4> last_WT_wxyz{1.0, 0.0, 0.0, 0.0};
  std::uint64_t button_presses = 0;  ///< of any button
};

/// Distributions over every cycle of a run, also those no longer kept.
struct TelemetryStatistics {
  rt::Percentiles period_us;
  rt::Percentiles wakeup_us;
  rt::Percentiles compute_us;
  rt::Percentiles report_age_us;
  rt::Percentiles sample_age_ms;
  std::uint64_t cycles = 0;
  std::uint64_t cycles_limited = 0;  ///< cycles in which a limit of the profile acted
  std::uint64_t missed_deadlines = 0;
  std::uint64_t samples_taken = 0;  ///< by the servo
  /// Cycles in contact by what the rendered method said, indexed by EstimateStatus.
  std::array<std::uint64_t, 5> rendered_status{};
  /// Cycles in contact, by the rendered method's candidate.
  std::array<std::uint64_t, kMaxCandidates> rendered_candidate{};
  std::array<std::uint64_t, kRungs> rung_cycles{};  ///< indexed by Rung
  std::uint64_t rung_changes = 0;
  OrientationStatistics orientation;
  double motor_warmth = 0.0;                   ///< the largest, see MotorWarmth::warmest()
  std::uint64_t cycles_warm = 0;               ///< in which it limited the current
  std::vector<RungChange> first_rung_changes;  ///< at most kChangesKept of them
  rt::Percentiles uncertainty_mN;  ///< of the rendered force in contact, where the method tells it
  std::uint64_t candidate_changes = 0;
  std::vector<CandidateChange> first_changes;  ///< at most kChangesKept of them
};

/// Drains the servo's records on its own thread, keeps them, and makes the live line of them.
/// Real-time: no; it is the thread that may wait. Threads: start and stop from one.
class Telemetry {
 public:
  Telemetry(ServoPorts& ports, TelemetryOptions options);
  ~Telemetry();
  Telemetry(const Telemetry&) = delete;
  Telemetry& operator=(const Telemetry&) = delete;

  void start();
  /// Drains what is left and joins. Idempotent.
  void stop();

  /// After stop(): the kept cycles, oldest first, and the statistics of all.
  const std::deque<CycleRecord>& records() const noexcept { return records_; }
  const TelemetryStatistics& statistics() const noexcept { return statistics_; }
  /// After stop(): the first exception on the thread that drains, in its own words; empty: none. It
  /// ended the callbacks and the live line. The loop, the statistics and the kept cycles went on.
  std::string trouble() const;
  /// CycleRecord::time_ns of the first cycle, which need not be kept any more.
  std::int64_t first_time_ns() const noexcept { return first_time_ns_; }

  /// When records are taken next after `now`, see TelemetryOptions::drain_interval.
  /// @param newest  of the cycles taken so far; null: none was
  /// @param rate_Hz  of the loop
  static rt::Clock::time_point next_drain(rt::Clock::time_point now, const CycleRecord* newest,
                                          std::chrono::milliseconds interval, double rate_Hz);

  static constexpr double kFlightRecord_s = 5.0;
  static constexpr std::size_t kChangesKept = 200;

  /// After stop(): writes the last `seconds` of cycles before `end_ns` (CycleRecord::time_ns) as
  /// CSV, one row each.
  /// @throws std::runtime_error naming the file and the system's reason.
  void write_flight_record(const std::string& path, double seconds = kFlightRecord_s,
                           std::int64_t end_ns = std::numeric_limits<std::int64_t>::max()) const;

 private:
  void drain();
  void drain_or_give_up() noexcept;
  void take_rung(const CycleRecord& record);
  void take_warmth(const CycleRecord& record);
  void take_orientation(const CycleRecord& record);
  void take_rendered(const CycleRecord& record);
  void say(const CycleRecord& record, const std::string& sentence);
  void say_live_line(const CycleRecord& record);
  const char* guard_text() const noexcept;
  std::string clock_text();

  ServoPorts& ports_;
  TelemetryOptions options_;
  std::deque<CycleRecord> records_;
  TelemetryStatistics statistics_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
  std::exception_ptr trouble_;  ///< of the thread that drains
  std::int64_t first_time_ns_ = 0;
  std::int64_t last_line_ns_ = 0;
  std::uint64_t cycles_at_last_line_ = 0;
  std::uint8_t last_candidate_ = 0;
  Rung last_rung_ = Rung::kZero;
  std::uint8_t last_buttons_ = 0;
  bool said_warm_ = false;
  bool damped_since_line_ = false;
  bool shortened_since_line_ = false;
};

#pragma GCC visibility pop
}  // namespace forcegrid::servo
