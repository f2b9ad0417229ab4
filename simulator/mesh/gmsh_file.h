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

/// Fills the surface of a mesh of tetrahedra with others, by Gmsh: it cuts the surface into charts
/// along ridges of 40 degrees and more, and meshes each anew.
/// @param edge_factor  length of the new edges relative to the present ones' mean.
/// @param who  begins every message.
/// Throws Error, also for a mesh of several regions, whose borders the surface does not tell.
/// Real-time: no. Threads: as read_gmsh().
MeshFile remeshed(const MeshFile& mesh, double edge_factor, const std::string& who);

}  // namespace forcegrid::simulator
