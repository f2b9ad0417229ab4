// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "simulator/mesh/mesh_file.h"

namespace forcegrid::simulator {

/// Reads the surface of an .obj file through tinyobjloader and cuts its polygons into triangles.
/// read_mesh_file() checks the content further. Throws Error, naming file and line, for a file that
/// can't be read, coordinates that are not finite numbers, faces of fewer than three corners, and
/// indices out of range. Real-time: no. Threads: any.
MeshFile read_obj(const std::string& file);

}  // namespace forcegrid::simulator
