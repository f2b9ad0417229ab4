// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/run/run_command.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// Whether the run starts an emulated device.
bool is_emulated(const RunOptions& options);

bool is_falcon(const profiles::DeviceProfile& profile);

/// Returns the tool of the simulator that the run starts: the scene's, changed by the tool options.
/// For a running simulator, which chooses its tool itself, returns the default.
/// @throws std::runtime_error for a tool option that --simulator or another tool option excludes.
simulator::ToolOptions tool_of(const RunOptions& options);

/// Rejects options that exclude each other, before anything is started.
/// @throws std::runtime_error naming the options and the remedy.
void check_together(const RunOptions& options, const simulator::ToolOptions& tool,
                    const profiles::DeviceProfile& profile);

/// Creates the folder for the results and checks that files can be written there.
/// @throws std::runtime_error with the folder, the system's reason and the remedy.
void prepare_folder(const std::string& folder);

}  // namespace forcegrid::cli
