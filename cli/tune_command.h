// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

struct TuneOptions {
  std::string device = "emulated:woodenhaptics_v2015";
  std::string profile;  ///< of an attached device; empty: woodenhaptics_v2015
  std::string scene = "small";
  std::string motion = "chirp";
  std::string hand = "firm";
  bool calibrated = false;  ///< the encoder counters are already valid, in every run
  std::vector<double> rates_Hz{250.0, 500.0, 1000.0};
  std::vector<int> fill_budgets{100, 300, 1000, 3000};
  /// Variants of one method from small to large.
  std::vector<std::string> methods{"hold",
                                   "linear",
                                   "rls",
                                   "tangent",
                                   "kriging samples=4",
                                   "kriging samples=8",
                                   "kriging samples=16",
                                   "kriging",
                                   "forcegrid cells=13",
                                   "forcegrid cells=25",
                                   "forcegrid",
                                   "forcegrid-mls cells=13",
                                   "forcegrid-mls cells=25",
                                   "forcegrid-mls",
                                   "kriging-bank",
                                   "auto budget=25",
                                   "auto budget=75",
                                   "auto budget=250",
                                   "auto budget=750",
                                   "auto"};
  double time_s = 300.0;
  double error_percent = 5.0;
  double missed_percent = 0.1;
  double compute_percent = 50.0;
  double margin_percent = 100.0;
  std::string out = "out";
  bool write = false;
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`.
void add_tune(Command& app, TuneOptions& options, std::function<int()>& action);

/// Evaluates all combinations of rate, fill budget and method on a path recorded with this device
/// and scene. Then runs those that are good enough in the loop itself, the cheapest first, until
/// one meets the tolerance, and proposes it.
/// @returns 0 with a proposal, 3 if no setting meets the tolerance. A picture that can't be drawn
/// is
///          a warning and changes neither.
/// @throws std::exception with a sentence for the user.
int tune_command(const TuneOptions& options);

}  // namespace forcegrid::cli
