#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace forcegrid::emulator {

/// When the firmware sampled its counters into a report, and what it saw: the truth that a host's
/// idea of the age of its counts can be compared with.
struct CounterSample {
  std::int64_t time_ns = 0;  ///< CLOCK_MONOTONIC
  std::array<std::int32_t, 6> counts{};
};

/// What one emulated device, and above all its motors, really did.
struct EmulatorReport {
  std::string device;  ///< profile name
  std::string busid;

  std::array<double, 3> final_current_mA{};    ///< flowing now, motors a, b, c
  std::array<double, 3> max_abs_current_mA{};  ///< largest ever
  std::array<double, 3> final_torque_Nm{};     ///< at the joints, now
  double motor_energy_delivered_J = 0.0;       ///< summed while the motors drove the arm (>= 0)
  double motor_energy_absorbed_J = 0.0;        ///< summed while the arm drove the motors (<= 0)
  /// Since current last flowed in any motor; 0 while it flows; nothing if it never did.
  std::optional<double> seconds_since_motors_nonzero;
  /// Currents commanded beyond the amplifier's range, which gave zero current instead; one for each
  /// motor and report.
  std::uint64_t out_of_range_currents = 0;
  std::uint64_t watchdog_trips = 0;

  std::uint64_t reports_sent = 0;      ///< IN reports collected by the host
  std::uint64_t reports_received = 0;  ///< OUT reports of the right length
  std::uint64_t short_reports = 0;     ///< OUT reports that were too short
  std::uint64_t long_reports = 0;      ///< OUT reports that were too long
  std::uint64_t reports_drained = 0;   ///< OUT reports skipped for a newer one
  std::uint64_t counters_loaded = 0;   ///< command 1 executed

  std::uint64_t frames = 0;          ///< bus frames run
  std::uint64_t frames_late = 0;     ///< of those, begun more than half a frame late
  std::uint64_t frames_skipped = 0;  ///< not run at all, their time having passed
  double worst_lateness_us = 0.0;    ///< of any frame
  double physics_skipped_s = 0.0;    ///< time not integrated after stalls of more than 1 s

  std::array<double, 3> tip_position_m{};  ///< frame D
  std::array<std::int32_t, 6> counters{};  ///< encoder counters a..f
  bool attached = false;                   ///< a client has imported the device
  bool configured = false;                 ///< and set its configuration
  bool unplugged = false;
};

/// The same names; an absent value is null.
void to_json(nlohmann::json& json, const EmulatorReport& report);

}  // namespace forcegrid::emulator
