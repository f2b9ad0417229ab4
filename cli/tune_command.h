#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/run_command.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

struct TuneOptions {
  std::string device = "emulated:woodenhaptics_v2015";
  std::string profile;  ///< of an attached device; empty: woodenhaptics_v2015
  std::string scene = "small";
  std::string motion = "chirp";
  std::vector<double> rates_Hz{250.0, 500.0, 1000.0};
  std::vector<int> fill_budgets{300, 1000};
  std::vector<std::string> methods{"hold", "rls", "forcegrid", "kriging"};
  double time_s = 300.0;
  double error_percent = 5.0;
  double missed_percent = 0.1;
  double compute_percent = 50.0;
  std::string out = "out";
  bool write = false;
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`.
void add_tune(CLI::App& app, TuneOptions& options, std::function<int()>& action);

/// Measures rate x fill budget x method on this computer, device and scene, and proposes the
/// cheapest setting that meets the tolerance.
/// @returns 0 with a proposal, 3 where no setting meets the tolerance.
/// @throws std::exception with a sentence for the user.
int tune_command(const TuneOptions& options);

}  // namespace forcegrid::cli
