#pragma once

#include <functional>
#include <string>

#include "cli/run/run_command.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

struct DoctorOptions {
  double seconds = 5.0;  ///< of each measurement; 0: none
  double rate_Hz = 500.0;
  std::string device;  ///< URL of a device to measure the round trip with; empty: none
  std::string profile = "woodenhaptics_v2015";
  std::string simulator;  ///< ADDR:PORT; empty: none
  bool fix = false;
  std::string root;    ///< before /sys, /dev, /proc and /etc; empty: this computer
  std::string report;  ///< Markdown file to send to the project; empty: none
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`.
void add_doctor(CLI::App& app, DoctorOptions& options, std::function<int()>& action);

/// Examines this computer and says of each finding what it costs and what mends it.
/// @returns 0 when nothing is wrong, 3 with warnings only, 4 when something is bad.
///          A device or simulator that can't be measured with is a bad finding, too.
/// @throws std::exception with a sentence for the user, e.g. for a profile that does not exist.
int doctor_command(const DoctorOptions& options);

}  // namespace forcegrid::cli
