#pragma once

#include "cli/run/run_command.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/tool_options.h"

namespace forcegrid::cli {

/// Whether the run starts the device that it drives.
bool is_emulated(const RunOptions& options);

bool is_falcon(const profiles::DeviceProfile& profile);

/// The tool of the simulator that is started: the scene's, with what was asked for. That of a
/// simulator that already runs is its own business, and taken for the default here.
/// @throws std::runtime_error for a tool that --simulator, or another tool option, excludes.
simulator::ToolOptions tool_of(const RunOptions& options);

/// Refuses options that exclude each other, before anything is started.
/// @throws std::runtime_error naming the options and the remedy.
void check_together(const RunOptions& options, const simulator::ToolOptions& tool,
                    const profiles::DeviceProfile& profile);

/// Makes the folder for the results, and tries whether files can be written there.
/// @throws std::runtime_error with the folder, the system's reason and the remedy.
void prepare_folder(const std::string& folder);

}  // namespace forcegrid::cli
