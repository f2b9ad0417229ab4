// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace forcegrid::simulator {

/// Vertices and elements of a mesh file. If the file has tetrahedra, its triangles are left out.
struct MeshFile {
  std::vector<Eigen::Vector3d> vertex;  ///< in the file's unit of length
  std::vector<std::array<std::int32_t, 3>> triangles;
  std::vector<std::array<std::int32_t, 4>> tetrahedra;
  /// Gmsh's physical groups of volumes: their names, or their numbers where they have none.
  std::vector<std::string> regions;
  std::vector<std::int32_t> region;  ///< by tetrahedron: one of `regions`, -1: none; or empty
};

/// Reads a mesh by the ending of its name: Gmsh's .msh through libgmsh, .obj (a surface; polygons
/// are cut into triangles) through tinyobjloader. libgmsh is loaded when the first .msh is read.
/// Throws Error, naming the file, if it can't be read, has another ending, or has no first-order
/// triangles or tetrahedra or elements other than these; for numbers that are not finite, faces of
/// fewer than three corners, indices out of range, two vertices at one place (nearer than 1e-6 of
/// the longest side) or with one number, and a vertex that no element uses. Never runs anything in
/// or beside the file. Real-time: no. Threads: one at a time, since libgmsh has one state for the
/// whole program.
MeshFile read_mesh_file(const std::string& file);

/// The checks of content that read_mesh_file() makes. @param who  begins the message.
void check(const MeshFile& mesh, const std::string& who);

/// Six volumes relative to the product of three edges: flatter tetrahedra have none.
inline constexpr double kFlat = 1e-6;

/// The faces that belong to one tetrahedron only, counterclockwise seen from outside.
/// Throws Error for a tetrahedron without volume and a face that more than two share.
std::vector<std::array<std::int32_t, 3>> outer_faces(const MeshFile& mesh, const std::string& who);

}  // namespace forcegrid::simulator
