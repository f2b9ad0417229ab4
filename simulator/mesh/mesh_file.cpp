// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/mesh_file.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/gmsh_file.h"
#include "simulator/mesh/missing_part.h"
#include "simulator/mesh/obj_file.h"
#include "text/file_kind.h"

namespace forcegrid::simulator {
namespace {

// Of the mesh's longest side: nearer vertices are one vertex written twice, perhaps with seven
// digits.
constexpr double kSamePlace = 1e-6;

using Triangle = std::array<std::int32_t, 3>;
using Corners = std::array<std::int32_t, 4>;

template <std::size_t kCorners>
void check_elements(const std::vector<std::array<std::int32_t, kCorners>>& elements,
                    const char* name, const std::string& who, std::vector<std::uint8_t>& used) {
  for (std::size_t e = 0; e < elements.size(); ++e) {
    rt::checkpoint_at(e, elements.size());
    auto corners = elements[e];
    for (const std::int32_t vertex : corners) {
      if (vertex < 0 || static_cast<std::size_t>(vertex) >= used.size()) {
        throw Error(who + name + " " + std::to_string(e + 1) + " names vertex " +
                    std::to_string(vertex + 1) + " of " + std::to_string(used.size()) +
                    "; correct the index");
      }
      used[static_cast<std::size_t>(vertex)] = 1;
    }
    std::sort(corners.begin(), corners.end());
    if (std::adjacent_find(corners.begin(), corners.end()) != corners.end()) {
      throw Error(who + name + " " + std::to_string(e + 1) +
                  " has the same vertex twice; remove it");
    }
  }
}

void check_places(const MeshFile& mesh, const std::string& who) {
  Eigen::Array3d low = mesh.vertex.front().array();
  Eigen::Array3d high = low;
  for (const Eigen::Vector3d& vertex : mesh.vertex) {
    low = low.min(vertex.array());
    high = high.max(vertex.array());
  }
  const double near = kSamePlace * (high - low).maxCoeff();
  std::vector<std::size_t> order(mesh.vertex.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&mesh](std::size_t a, std::size_t b) {
    return mesh.vertex[a].x() < mesh.vertex[b].x();
  });
  for (std::size_t i = 0; i < order.size(); ++i) {
    rt::checkpoint_at(i, order.size());
    const Eigen::Vector3d& here = mesh.vertex[order[i]];
    for (std::size_t k = i + 1; k < order.size(); ++k) {
      const Eigen::Vector3d& there = mesh.vertex[order[k]];
      if (there.x() - here.x() > near) {
        break;
      }
      if ((there - here).norm() <= near) {
        const auto [first, second] = std::minmax(order[i], order[k]);
        throw Error(who + "vertices " + std::to_string(first + 1) + " and " +
                    std::to_string(second + 1) + " lie at the same place; merge them");
      }
    }
  }
}

}  // namespace

void check(const MeshFile& mesh, const std::string& who) {
  if (mesh.triangles.empty() && mesh.tetrahedra.empty()) {
    throw Error(who + "no triangle and no tetrahedron; save the elements with the mesh");
  }
  for (std::size_t i = 0; i < mesh.vertex.size(); ++i) {
    if (!mesh.vertex[i].allFinite()) {
      throw Error(who + "a coordinate of vertex " + std::to_string(i + 1) +
                  " is not finite; correct it");
    }
  }
  std::vector<std::uint8_t> used(mesh.vertex.size(), 0);
  check_elements(mesh.triangles, "triangle", who, used);
  check_elements(mesh.tetrahedra, "tetrahedron", who, used);
  const auto unused = std::find(used.begin(), used.end(), 0);
  if (unused != used.end()) {
    throw Error(who + "vertex " + std::to_string(unused - used.begin() + 1) +
                " belongs to no element; remove it");
  }
  check_places(mesh, who);
}

std::vector<Triangle> outer_faces(const MeshFile& mesh, const std::string& who) {
  std::map<Triangle, std::pair<Triangle, int>> faces;  // by sorted vertices
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
    rt::checkpoint_at(t, mesh.tetrahedra.size());
    Corners v = mesh.tetrahedra[t];
    const auto at = [&](std::size_t k) { return mesh.vertex[static_cast<std::size_t>(v[k])]; };
    const Eigen::Vector3d a = at(1) - at(0);
    const Eigen::Vector3d b = at(2) - at(0);
    const Eigen::Vector3d c = at(3) - at(0);
    const double six_volumes = a.dot(b.cross(c));
    if (!(std::abs(six_volumes) > kFlat * a.norm() * b.norm() * c.norm())) {
      throw Error(who + "tetrahedron " + std::to_string(t + 1) + " is flat; remesh");
    }
    if (six_volumes < 0.0) {
      std::swap(v[2], v[3]);
    }
    for (const Triangle& face : {Triangle{v[0], v[2], v[1]}, Triangle{v[0], v[1], v[3]},
                                 Triangle{v[1], v[2], v[3]}, Triangle{v[0], v[3], v[2]}}) {
      Triangle key = face;
      std::sort(key.begin(), key.end());
      auto& [first, count] = faces[key];
      first = face;
      ++count;
    }
  }
  std::vector<Triangle> outer;
  for (const auto& [key, face] : faces) {
    if (face.second > 2) {
      throw Error(who + "more than two tetrahedra share the face of vertices " +
                  std::to_string(key[0] + 1) + ", " + std::to_string(key[1] + 1) + " and " +
                  std::to_string(key[2] + 1) + "; remesh");
    }
    if (face.second == 1) {
      outer.push_back(face.first);
    }
  }
  return outer;
}

MeshFile read_mesh_file(const std::string& file) {
  const std::string who = "mesh file " + file + ": ";
  const std::string why_not = text::why_no_file(file);
  if (!why_not.empty()) {
    throw MissingPart(who + why_not + "; write its path, relative to the scene's file");
  }
  MeshFile mesh;
  if (file.ends_with(".msh")) {
    mesh = read_gmsh(file);
  } else if (file.ends_with(".obj")) {
    mesh = read_obj(file);
  } else {
    throw Error(who + "unknown ending; convert it to Gmsh's .msh or to .obj");
  }
  check(mesh, who);
  return mesh;
}

}  // namespace forcegrid::simulator
