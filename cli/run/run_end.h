// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace forcegrid::cli {

/// Exit status of a run that an emergency stop ended.
inline constexpr int kEmergencyStatus = 3;
/// Exit status of a run that found no simulator or lost it.
inline constexpr int kNoSimulatorStatus = 4;

/// Why a run ended. Of several reasons the first in this order counts.
enum class RunEnd : std::uint8_t {
  kEmergencyStop,
  kFault,
  kOtherDevice,    ///< a fault of another device in this run or at its simulator
  kSignal,         ///< SIGINT, SIGTERM or SIGHUP
  kNoSimulator,    ///< no sample ever came
  kLostSimulator,  ///< no sample came any more
  kScene,          ///< a person chose another scene in the live view: the next run has begun
  kTime,           ///< --seconds are over
};

/// For programs: "emergency_stop", "fault", "other_device", "SIGINT" (or the other signals' names),
/// "no_simulator", "lost_simulator", "scene", "time".
/// @param signal_name  of the signal; empty unless it is kSignal.
std::string name_of(RunEnd end, const std::string& signal_name);

/// The exit status: 0 for kTime and kScene, 1 fault of this or another device, 3 emergency stop, 4
/// no simulator, 128 + `signal`.
int status_of(RunEnd end, int signal) noexcept;

/// The exit statuses for --help, one a line.
const char* run_status_help() noexcept;

}  // namespace forcegrid::cli
