// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "rt/clock.h"

namespace forcegrid::emulator {

/// The program in a W2 device: the ping-pong loop, the watchdog, current to PWM, the counters and
/// the calibration latch, as the device sheet describes them. Time is an argument, so that tests
/// can simulate it; it must not decrease.
///
/// Report IN (14 bytes, little-endian int16): counters a..f, info (1: calibration button pressed
/// since the last command 1). Report OUT: current a, b, c [mA], command (1: load counters a, b, c
/// from the next three and d, e, f from the currents; anything else: apply the currents), attr0..2.
/// W3 has the same two reports in 64 bytes: zeros follow IN, and what follows OUT is ignored, since
/// hosts send whatever their memory holds there. Its program is not published; hosts treat it as
/// W2. W6, which is this project's own, has them in 20 bytes: OUT has the currents of three motors
/// more behind a W2's report. Source: haptikfabrikenapi `firmware/main.cpp` (b8d6c94), by way of
/// its fact sheet. Real-time: no allocation, lock or throw after construction. Threads: one.
class W2Firmware {
 public:
  static constexpr std::size_t kReportBytes = 14;  ///< of both reports that are used
  static constexpr std::size_t kPacketBytes = 64;  ///< of both interrupt endpoints
  /// OUT packets the device accepts before it answers NAK. The sheet mentions queued reports but no
  /// depth; with two, the least, there is something to drain.
  static constexpr std::size_t kOutDepth = 2;
  static constexpr rt::Duration kStartUp = std::chrono::seconds(1);
  static constexpr rt::Duration kWatchdog = std::chrono::milliseconds(500);
  static constexpr double kZeroCurrentDuty = 0.5;

  /// An IN report as sent over the wire.
  class Report {
   public:
    using value_type = std::uint8_t;
    using const_iterator = const std::uint8_t*;
    [[nodiscard]] const std::uint8_t* begin() const noexcept { return bytes_.data(); }
    [[nodiscard]] const std::uint8_t* end() const noexcept { return bytes_.data() + size_; }
    [[nodiscard]] std::size_t size() const noexcept { return size_; }
    [[nodiscard]] std::uint8_t operator[](std::size_t i) const noexcept { return bytes_[i]; }

   private:
    friend class W2Firmware;
    std::array<std::uint8_t, kPacketBytes> bytes_{};
    std::size_t size_ = 0;
  };
  using Counters = std::array<std::int32_t, 6>;

  /// What the pins of the motor amplifiers see.
  struct Outputs {
    bool motor_enable = false;
    /// Of motors a, b, c, and of a W6's wrist.
    std::array<double, 6> duty{kZeroCurrentDuty, kZeroCurrentDuty, kZeroCurrentDuty,
                               kZeroCurrentDuty, kZeroCurrentDuty, kZeroCurrentDuty};
  };

  struct Statistics {
    std::uint64_t reports_sent = 0;      ///< IN reports the host has collected
    std::uint64_t reports_received = 0;  ///< OUT reports of the right length, drained ones included
    std::uint64_t short_reports = 0;     ///< OUT reports of fewer bytes
    std::uint64_t long_reports = 0;      ///< OUT reports of more bytes
    std::uint64_t reports_drained = 0;   ///< OUT reports skipped for a newer one
    std::uint64_t reports_applied = 0;   ///< OUT reports acted on; each has fed the watchdog
    std::uint64_t counters_loaded = 0;   ///< command 1 executed
    std::uint64_t watchdog_trips = 0;
  };

  /// @param full_scale_current_A I_full, the current at a duty of 90 %; positive.
  /// @param wire_bytes length of a report on the wire, 14 (W2) to 64 (W3).
  /// @param six_motors bytes 14 to 19 of OUT are the wrist's currents (W6).
  explicit W2Firmware(double full_scale_current_A, std::size_t wire_bytes = kReportBytes,
                      bool six_motors = false) noexcept;

  /// Positions of the six encoders [counts] as the quadrature decoders see them. The counters
  /// change by the difference from the last call, and start from the first.
  void turn_encoders(const std::array<std::int64_t, 6>& position_counts) noexcept;
  /// Sets the counters [counts], as if the shafts had been turned unseen.
  void set_counters(const Counters& counts) noexcept { counters_ = counts; }
  void press_calibration_button() noexcept { info_ = true; }
  /// The button on the stylus of a device that has one: while it is down the report's counter d is
  /// kStylusOffset more than the counter.
  void hold_stylus_button(bool down) noexcept { stylus_down_ = down; }
  static constexpr std::uint16_t kStylusOffset = 10000;

  /// From now on a second processor in the device computes the motors' currents: those of the
  /// host's reports are not applied. The reports feed the watchdog as before, so that the motors
  /// are on only while a host is there.
  void hand_over() noexcept { handed_over_ = true; }
  /// The second processor's currents [mA]. Without effect unless handed over, and while the
  /// watchdog is not running.
  void apply(const std::array<std::int16_t, 3>& current_mA) noexcept;

  /// Puts the device into or out of its configuration. Leaving it empties both endpoints, as a bus
  /// reset does; the program continues.
  void set_configured(bool configured, rt::TimePoint now) noexcept;

  /// Power fails and returns: counters, calibration button, packets and outputs are as at power-up.
  void reboot() noexcept;

  /// The host sends a packet to EP1 OUT. @returns false for NAK: full, or not configured.
  [[nodiscard]] bool offer_out(std::span<const std::uint8_t> packet) noexcept;
  /// The host asks EP1 IN. @returns nothing for NAK.
  std::optional<Report> collect_in() noexcept;
  /// Whether collect_in() would give a report.
  [[nodiscard]] bool in_armed() const noexcept { return in_armed_; }
  /// What collect_in() would give; while in_armed().
  [[nodiscard]] const Report& in_report() const noexcept { return in_report_; }

  /// Runs the program until it has to wait for the host or for time.
  /// @returns true when it has sampled the counters into a new IN report.
  bool run(rt::TimePoint now) noexcept;

  /// When the watchdog will trip if nothing feeds it; nothing while it is not running.
  [[nodiscard]] std::optional<rt::TimePoint> watchdog_deadline() const noexcept;
  /// Trips the watchdog if `now` has reached its deadline. @returns true if it did.
  bool check_watchdog(rt::TimePoint now) noexcept;

  [[nodiscard]] bool configured() const noexcept { return configured_; }
  [[nodiscard]] std::size_t wire_bytes() const noexcept { return wire_bytes_; }
  [[nodiscard]] const Outputs& outputs() const noexcept { return outputs_; }
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }
  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }
  /// When the watchdog was last fed; nothing before the first time.
  [[nodiscard]] std::optional<rt::TimePoint> last_feed() const noexcept { return last_feed_; }

 private:
  enum class State : std::uint8_t {
    kAwaitConfiguration,
    kStartingUp,
    kArmReport,
    kAwaitCollection,
    kAwaitReport
  };
  struct Packet {
    std::array<std::uint8_t, kPacketBytes> bytes{};
    std::size_t size = 0;
  };

  Report sample() const noexcept;
  void act_on(const Packet& packet, rt::TimePoint now) noexcept;
  void drive(std::size_t motor, std::int16_t current_mA) noexcept;

  double full_scale_current_A_;
  std::size_t wire_bytes_;
  bool six_motors_;
  State state_ = State::kAwaitConfiguration;
  bool configured_ = false;
  rt::TimePoint started_{};
  Counters counters_{};
  std::optional<std::array<std::int64_t, 6>> encoders_;
  bool info_ = false;
  bool stylus_down_ = false;
  Report in_report_{};
  bool in_armed_ = false;
  std::array<Packet, kOutDepth> out_queue_;
  std::size_t out_count_ = 0;
  std::optional<rt::TimePoint> last_feed_;
  bool watchdog_running_ = false;
  bool handed_over_ = false;
  Outputs outputs_;
  Statistics statistics_;
};

}  // namespace forcegrid::emulator
