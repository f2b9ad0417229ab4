// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::emulator {

/// When the firmware sampled its counters into a report, and their values: the reference for a
/// host's estimate of the age of its counts.
struct CounterSample {
  std::int64_t time_ns = 0;  ///< CLOCK_MONOTONIC
  std::array<std::int32_t, 6> counts{};
};

/// The record of one fault that was requested.
struct FaultRecord {
  std::string name;
  std::uint64_t times = 0;    ///< how often it did something
  std::int64_t first_ns = 0;  ///< CLOCK_MONOTONIC of the first time; 0: never
  /// Time from the first act until current last flowed, 0 if none flowed from then on; nothing
  /// while it flows, or if the fault did nothing.
  std::optional<double> seconds_until_motors_off;
};

/// Results that only a Novint Falcon has.
struct FalconReport {
  std::string firmware_state;                     ///< "cold", "auto-baud", "loading" or "running"
  std::array<std::int32_t, 3> final_command{};    ///< in force now, motors 1, 2, 3
  std::array<std::int32_t, 3> max_abs_command{};  ///< largest ever
  std::array<double, 3> max_abs_torque_Nm{};      ///< the same at the driven angles
  std::uint64_t saturated_commands = 0;     ///< beyond the limit, one for each motor and packet
  std::uint64_t malformed_packets = 0;      ///< '<' that no well-formed packet followed
  std::uint64_t serial_overruns = 0;        ///< bytes lost because the host did not collect them
  std::uint64_t serial_framing_errors = 0;  ///< bytes unreadable at the host's baud rate
  std::uint64_t boot_handshakes = 0;        ///< answered by the boot loader
  std::uint64_t firmware_bytes_loaded = 0;  ///< of all images
  std::uint64_t firmware_wrong_keys = 0;    ///< images that were none
  std::uint64_t firmware_starts = 0;        ///< images loaded to their end
  std::array<bool, 3> homed{};
  std::uint8_t lights = 0;             ///< 2 green, 4 blue, 8 red
  std::uint64_t blocked_substeps = 0;  ///< of the physics, in which the legs would not have closed
};

/// What a W2's second processor did, see CoreLine.
struct CoreUse {
  std::uint64_t cycles = 0;         ///< states that it was sent
  std::uint64_t answers = 0;        ///< newest answers that were taken
  std::uint64_t broken_frames = 0;  ///< answers that were damaged
  std::uint64_t silences = 0;       ///< times that it fell silent and the motors were set to zero
  /// From a state to its answer, in steps of the bus frame: mean, and longest.
  double mean_latency_ms = 0.0, worst_latency_ms = 0.0;
};

/// Where the wrist of a device that has one is, see Wrist.
struct WristReport {
  std::array<double, 3> angle_rad{};
  std::array<double, 4> orientation_wxyz{1.0, 0.0, 0.0, 0.0};  ///< of the tool's frame in D
  std::uint64_t stylus_clicks = 0;  ///< how often the button on the stylus has gone down
  // Of a wrist with motors, see DrivenWrist; else zero.
  std::array<double, 3> final_current_mA{};
  std::array<double, 3> max_abs_current_mA{};
  std::array<double, 3> final_torque_Nm{};  ///< of the motors at the joints
  std::array<double, 3> hand_torque_Nm{};   ///< of the hand on the tool, frame D
};

/// What came for the hand, see HandTargetSocket.
struct HandTargetUse {
  std::uint64_t taken = 0;      ///< well-formed datagrams
  std::uint64_t malformed = 0;  ///< dropped ones
};

/// What one emulated device, and above all its motors, did.
struct EmulatorReport {
  std::string device;  ///< profile name
  std::string busid;
  std::string hand;  ///< that holds it, or that it goes over to: "firm", ...

  std::array<double, 3> final_current_mA{};    ///< flowing now, motors a, b, c
  std::array<double, 3> max_abs_current_mA{};  ///< largest ever
  std::array<double, 3> final_torque_Nm{};     ///< at the joints, now
  double motor_energy_delivered_J = 0.0;       ///< summed while the motors drove the arm (>= 0)
  double motor_energy_absorbed_J = 0.0;        ///< summed while the arm drove the motors (<= 0)
  /// Time since current last flowed in any motor; 0 while it flows; nothing if it never did.
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
  std::uint64_t frames_skipped = 0;  ///< not run at all, because their time had passed
  double worst_lateness_us = 0.0;    ///< of any frame
  double physics_skipped_s = 0.0;    ///< time not integrated after stalls of more than 1 s

  std::array<double, 3> tip_position_m{};  ///< frame D
  std::array<std::int32_t, 6> counters{};  ///< encoder counters a..f
  bool attached = false;                   ///< a client has imported the device
  bool configured = false;                 ///< and set its configuration
  bool unplugged = false;

  std::optional<WristReport> wrist;          ///< of an arm with a wrist
  std::optional<CoreUse> core;               ///< of an arm with a second processor
  std::optional<HandTargetUse> hand_target;  ///< the same for all devices; nothing without a socket

  std::vector<FaultRecord> faults;     ///< in the order in which they were requested
  std::int64_t motors_last_on_ns = 0;  ///< CLOCK_MONOTONIC; 0: never, or no fault was asked for

  /// Of a Falcon alone. A Falcon has no currents, report lengths, draining and command 1: these
  /// members above stay zero, and its answered packets count as reports both sent and received.
  std::optional<FalconReport> falcon;
};

/// The same names; an absent value is null.
void to_json(nlohmann::json& json, const FaultRecord& record);
/// The same names; an absent value is null. For a Falcon the members of `falcon` stand beside the
/// others, and members that it does not have are left out.
void to_json(nlohmann::json& json, const EmulatorReport& report);

}  // namespace forcegrid::emulator
