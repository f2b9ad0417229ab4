// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/mesh/tool_options.h"
#include "text/toml_table.h"

namespace forcegrid::simulator {

/// The table [tool] of a scene's file, whose keys docs/scenes.md describes; the default tool
/// without one.
/// @throws text::TomlError naming file, line and key for what is unknown, out of range, or of
/// no use to that tool.
ToolOptions read_scene_tool(const text::TomlTable& root);

}  // namespace forcegrid::simulator
