// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/mesh/tool_options.h"
#include "text/toml_table.h"

namespace forcegrid::simulator {

/// The tool of the table [tool] in a scene's file, whose keys docs/scenes.md describes; without the
/// table, the default tool.
/// @throws text::TomlError naming file, line and key for a key that is unknown, out of range, or
///   without effect on that tool.
ToolOptions read_scene_tool(const text::TomlTable& root);

}  // namespace forcegrid::simulator
