// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace forcegrid::simulator {

/// Number of nodes that a .msh file states, in any version of the format, text or binary; 0 if it
/// has no section of nodes. Source: Gmsh 4.8 reference manual, section 9, "MSH file format" and its
/// legacy versions.
/// Throws Error, beginning with `who`, for a file that can't be opened, does not begin as a .msh
/// file does (Gmsh would run it as a script, which may start programs), or states no number.
/// Real-time: no. Threads: any.
std::size_t stated_node_count(const std::string& file, const std::string& who);

}  // namespace forcegrid::simulator
