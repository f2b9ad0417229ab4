// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/run/run_command.h"

namespace forcegrid::cli {

struct DevicesOptions {
  std::vector<std::string> usbip;  ///< HOST or HOST:PORT
  std::string root;                ///< prefix of /sys, /dev, /proc and /etc; empty: this computer
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`.
void add_devices(Command& app, DevicesOptions& options, std::function<int()>& action);

/// Lists every device that may be a supported one and, for each that can't be opened, the reason.
/// @returns 0 if a device can be used, 3 if devices exist but none can be used, 4 if none exists, 1
///         if a USB/IP host can't be queried and no other device can be used.
int devices_command(const DevicesOptions& options);

}  // namespace forcegrid::cli
