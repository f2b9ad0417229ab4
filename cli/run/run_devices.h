// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

/// Devices of one run, at most: as many as a simulator serves tools.
inline constexpr std::size_t kMostDevices = 4;

inline constexpr double kToolStiffness_N_per_m = 200.0;  ///< between tools, by default
inline constexpr double kLargestToolStiffness_N_per_m = 5000.0;

/// Renders one scene through several devices: a servo loop each, in this process, and one simulator
/// for all. A signal, the emergency stop or the end of the time ends all loops; a fault of one ends
/// all or only that one (RunOptions::fault_stops). Prints a summary of each; the JSON has them as
/// `devices`.
/// @returns the program's exit status: that of the device whose end counts first in RunEnd's order.
/// @throws std::exception with a sentence for the user if the run can't be set up.
int run_devices(const RunOptions& options);

/// The options of a run with one device.
/// @throws std::runtime_error for options of several devices, or of a tool number without
/// --simulator.
RunOptions the_only_device(const RunOptions& options);

/// The options of each device's own run, in the order of the flags.
/// @throws std::runtime_error for options that exclude several devices.
std::vector<RunOptions> options_of_each(const RunOptions& options);

/// [mm] Where `count` devices stand in the scene by default: 30 mm apart from left to right, along
/// W's y axis, about W's origin.
std::vector<std::array<double, 3>> default_offsets_mm(std::size_t count);

/// "X,Y,Z" in mm.
Check offset_check();
/// A fault of the emulator, with "N:" before it if it is of device N alone.
Check device_fault_check();
/// A motion of every emulated hand, or of each in turn, separated by commas.
Check motions_check();

}  // namespace forcegrid::cli
