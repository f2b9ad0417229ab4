#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/run/run_command.h"

namespace CLI {
class App;
}

namespace forcegrid::cli {

struct DevicesOptions {
  std::vector<std::string> usbip;  ///< HOST or HOST:PORT
  std::string root;                ///< before /sys, /dev, /proc and /etc; empty: this computer
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`.
void add_devices(CLI::App& app, DevicesOptions& options, std::function<int()>& action);

/// Lists every device that could be a supported one, and why not for each that can't be opened.
/// @returns 0 when one can be used, 3 when there are devices but none of them can, 4 when there is
///          none, 1 when a USB/IP host can't be asked and nothing else can be used.
int devices_command(const DevicesOptions& options);

}  // namespace forcegrid::cli
