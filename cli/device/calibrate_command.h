#pragma once

#include <functional>
#include <string>

#include "cli/run/run_command.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

struct CalibrateOptions {
  std::string device = "emulated:woodenhaptics_v2015";
  std::string profile;   ///< what the device is believed to be; empty: as `run` takes it
  std::string firmware;  ///< file for a Falcon in which none runs
  double tip_mass_kg = 0.0;
  bool calibrated = false;  ///< the counters are right already
  bool no_range = false;
  bool no_strokes = false;
  bool quick = false;
  bool yes = false;
  double let_go_s = 5.0;
  double rate_Hz = 500.0;
  int device_timeout_ms = 100;  ///< silence after which the device counts as failed
  std::string write;            ///< file instead of the unit's own; empty: that
  bool dry_run = false;
  JsonTarget json;
};

/// Exit status when a check has failed, and nothing was written for that.
inline constexpr int kCheckFailedStatus = 3;

/// Adds the subcommand, which sets `action`.
void add_calibrate(CLI::App& app, CalibrateOptions& options, std::function<int()>& action);

/// Homes a device, looks at directions, range, friction and torque constants, and writes what was
/// found as a profile of this unit.
/// @returns 0 when all is well, kCheckFailedStatus.
/// @throws std::exception with a sentence for the user; the motors have no current then.
int calibrate_command(const CalibrateOptions& options);

}  // namespace forcegrid::cli
