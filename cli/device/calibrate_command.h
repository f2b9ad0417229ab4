// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

struct CalibrateOptions {
  std::string device = "emulated:woodenhaptics_v2015";
  std::string profile;   ///< assumed profile of the device; empty: as in `run`
  std::string firmware;  ///< file for a Falcon that runs none
  double tip_mass_kg = 0.0;
  bool calibrated = false;  ///< the encoder counters are already valid
  bool no_range = false;
  bool no_strokes = false;
  bool quick = false;
  bool yes = false;
  double let_go_s = 5.0;
  double rate_Hz = 500.0;
  int device_timeout_ms = 100;  ///< silence after which the device counts as failed
  bool share = false;           ///< another program may have the device open
  std::string write;            ///< profile to write; empty: the unit's own file
  bool dry_run = false;
  JsonTarget json;
};

/// Exit status if a check failed; the command then writes nothing.
inline constexpr int kCheckFailedStatus = 3;

/// Adds the subcommand, which sets `action`.
void add_calibrate(Command& app, CalibrateOptions& options, std::function<int()>& action);

/// Homes a device, checks its directions and range, measures friction and torque constants, and
/// writes the result as the profile of this unit.
/// @returns 0, or kCheckFailedStatus.
/// @throws std::exception with a sentence for the user; the motors then have no current.
int calibrate_command(const CalibrateOptions& options);

}  // namespace forcegrid::cli
