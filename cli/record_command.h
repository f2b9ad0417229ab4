// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

struct ReplayOptions {
  std::string file;
  std::string device;    ///< profile; empty: the recording's
  std::string scene;     ///< empty: the recording's, or block
  std::string method;    ///< empty: the method that the recording rendered
  double seconds = 0.0;  ///< length of the path to replay; 0: all of it
  std::string out = "out";
  JsonTarget json;
};

struct PlotOptions {
  std::string file;
  std::optional<double> from_s;  ///< since the start of the recording
  std::optional<double> to_s;
  std::string zoom;  ///< empty, or contact
  std::vector<std::string> formats{"svg", "png"};
  int width_px = 1000;
  std::string out = "out";
  JsonTarget json;
};

/// Add the subcommands, which set `action`.
void add_replay(Command& app, ReplayOptions& options, std::function<int()>& action);
void add_plot(Command& app, PlotOptions& options, std::function<int()>& action);

/// Makes the emulated hand repeat a recording's path from the first contact on, through the whole
/// stack, and prints how closely the tool followed.
/// @returns 0, or 1 after a fault.
/// @throws std::exception with a sentence for the user.
int replay_command(const ReplayOptions& options);

/// Draws a recording's standard pictures and prints a summary of its contents.
/// @returns 0.
/// @throws std::exception with a sentence for the user.
int plot_command(const PlotOptions& options);

}  // namespace forcegrid::cli
