// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "simulator/mesh/mesh_file.h"

namespace forcegrid::simulator {

/// Reads Gmsh's .msh through libgmsh, which is loaded on the first call. What is read is not
/// checked beyond that: read_mesh_file() does that. Throws Error naming the file: one that can't be
/// read, has elements other than first-order lines, triangles and tetrahedra, or nodes that no
/// element uses or that share a number; and where libgmsh can't be loaded. Real-time: no. Threads:
/// one at a time, since libgmsh has one state for the whole program.
MeshFile read_gmsh(const std::string& file);

}  // namespace forcegrid::simulator
