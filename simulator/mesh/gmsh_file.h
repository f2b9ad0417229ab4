// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "simulator/mesh/mesh_file.h"

namespace forcegrid::simulator {

/// Reads Gmsh's .msh through libgmsh, which the first call loads. read_mesh_file() checks the
/// content further. Throws Error, naming the file, if it can't be read, has elements other than
/// first-order lines, triangles and tetrahedra, has nodes that no element uses or that share a
/// number, or if libgmsh can't be loaded. Real-time: no. Threads: one at a time, since libgmsh has
/// one state for the whole program.
MeshFile read_gmsh(const std::string& file);

}  // namespace forcegrid::simulator
