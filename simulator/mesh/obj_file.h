// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "simulator/mesh/mesh_file.h"

namespace forcegrid::simulator {

/// Reads the surface of an .obj file through tinyobjloader and cuts its polygons into triangles.
/// What is read is not checked beyond that: read_mesh_file() does that. Throws Error naming the
/// file and line: one that can't be read, coordinates that are not finite numbers, faces of fewer
/// than three corners, or indices out of range. Real-time: no. Threads: any.
MeshFile read_obj(const std::string& file);

}  // namespace forcegrid::simulator
