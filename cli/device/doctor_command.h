// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

struct DoctorOptions {
  double seconds = 5.0;  ///< duration of each measurement; 0: do not measure
  double rate_Hz = 500.0;
  std::string device;  ///< URL of a device to measure the round trip with; empty: none
  bool share = false;  ///< another program may have the device open
  std::string profile = "woodenhaptics_v2015";
  std::string simulator;  ///< ADDR:PORT; empty: none
  bool fix = false;
  std::string root;    ///< prefix of /sys, /dev, /proc and /etc; empty: this computer
  std::string report;  ///< Markdown file to send to the project; empty: none
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`.
void add_doctor(Command& app, DoctorOptions& options, std::function<int()>& action);

/// Examines this computer and prints for each finding its effect and its remedy.
/// @returns 0 if nothing is wrong, 3 for warnings only, 4 for a bad finding. A device or simulator
///         whose round trip can't be measured is a bad finding.
/// @throws std::exception with a sentence for the user, e.g. for a profile that does not exist.
int doctor_command(const DoctorOptions& options);

}  // namespace forcegrid::cli
