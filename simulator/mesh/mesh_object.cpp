// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/mesh_object.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/rest_surface.h"
#include "simulator/mesh/tetrahedra.h"
#include "text/nearest_name.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Triangle = std::array<std::int32_t, 3>;
using text::number_text;

constexpr double kShortest_m = 0.005;
constexpr double kLongest_m = 1.0;
// element_quality() of a sliver. Meshers leave 0.1 and more.
constexpr double kSliver = 0.01;

struct Box {
  Eigen::Vector3d low_m;
  Eigen::Vector3d high_m;
};

Box box_of(const std::vector<Eigen::Vector3d>& points_m) {
  Box box{points_m.front(), points_m.front()};
  for (const Eigen::Vector3d& point_m : points_m) {
    box.low_m = box.low_m.cwiseMin(point_m);
    box.high_m = box.high_m.cwiseMax(point_m);
  }
  return box;
}

void check_size(const Box& box, const MeshObjectOptions& options) {
  const double longest_m = (box.high_m - box.low_m).maxCoeff();
  if (!(longest_m >= kShortest_m && longest_m <= kLongest_m)) {
    throw Error(options.who + "with a unit of " + number_text(options.unit_m) + " m it is " +
                number_text(longest_m) + " m long, which nobody can touch; write the " +
                "unit that makes it 0.005 to 1 m");
  }
}

void check_sides(const std::vector<Triangle>& triangles, const std::string& who) {
  std::map<std::pair<std::int32_t, std::int32_t>, std::size_t> directed;
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    rt::checkpoint_at(t, triangles.size());
    for (std::size_t k = 0; k < 3; ++k) {
      const std::pair edge{triangles[t][k], triangles[t][(k + 1) % 3]};
      const auto [found, first] = directed.emplace(edge, t);
      if (!first) {
        throw Error(who + "triangles " + std::to_string(found->second + 1) + " and " +
                    std::to_string(t + 1) + " run the same way along the edge from vertex " +
                    std::to_string(edge.first + 1) + " to " + std::to_string(edge.second + 1) +
                    "; turn one around, or remove what meets there besides two triangles");
      }
    }
  }
}

void turn_outward(SpringMesh& mesh) {
  double six_volumes_m3 = 0.0;
  for (const auto& triangle : mesh.triangles) {
    const auto at = [&](std::size_t k) -> const Eigen::Vector3d& {
      return mesh.rest_position_W[static_cast<std::size_t>(triangle[k])];
    };
    six_volumes_m3 += at(0).dot(at(1).cross(at(2)));
  }
  if (six_volumes_m3 < 0.0) {
    for (auto& triangle : mesh.triangles) {
      std::swap(triangle[1], triangle[2]);
    }
  }
}

template <typename Elements>
void add_edges(const Elements& elements, std::set<std::pair<std::int32_t, std::int32_t>>& edges) {
  std::size_t number = 0;
  for (const auto& element : elements) {
    rt::checkpoint_at(number++, elements.size());
    for (std::size_t i = 0; i < element.size(); ++i) {
      for (std::size_t k = i + 1; k < element.size(); ++k) {
        edges.insert(std::minmax(element[i], element[k]));
      }
    }
  }
}

std::string place_text(const std::array<Eigen::Vector3d, 4>& corner) {
  const Eigen::Vector3d middle = 0.25 * (corner[0] + corner[1] + corner[2] + corner[3]);
  return "(" + number_text(middle.x()) + ", " + number_text(middle.y()) + ", " +
         number_text(middle.z()) + ")";
}

// Places are in the file's unit, where its owner finds them.
void check_tetrahedra(const MeshFile& file, const std::string& who) {
  if (file.tetrahedra.empty()) {
    throw Error(who + "a material needs tetrahedra, and it has triangles only; mesh its volume, " +
                "or give it springs (stiffness_N_per_m and law) instead of a material");
  }
  for (std::size_t t = 0; t < file.tetrahedra.size(); ++t) {
    rt::checkpoint_at(t, file.tetrahedra.size());
    std::array<Eigen::Vector3d, 4> corner;
    for (std::size_t k = 0; k < 4; ++k) {
      corner[k] = file.vertex[static_cast<std::size_t>(file.tetrahedra[t][k])];
    }
    const Eigen::Vector3d a = corner[1] - corner[0];
    const Eigen::Vector3d b = corner[2] - corner[0];
    const Eigen::Vector3d c = corner[3] - corner[0];
    const double six_volumes = a.dot(b.cross(c));
    const std::string name = "tetrahedron " + std::to_string(t + 1) + " at ";
    if (std::abs(six_volumes) <= kFlat * a.norm() * b.norm() * c.norm()) {
      throw Error(who + name + place_text(corner) + " is flat, it has no volume; remesh");
    }
    if (six_volumes < 0.0) {
      throw Error(
          who + name + place_text(corner) +
          " is inverted: its fourth vertex lies on the wrong side of the others; swap two " +
          "of its vertices, or remesh");
    }
    const double quality = element_quality(corner);
    if (quality < kSliver) {
      throw Error(who + name + place_text(corner) + " is a sliver of quality " +
                  number_text(quality) + " (a regular one has 1, " + number_text(kSliver) +
                  " is the least); remesh or optimise the mesh");
    }
  }
}

std::size_t region_number(const MeshFile& file, const MeshObjectOptions& options,
                          const std::string& region) {
  const auto found = std::find(file.regions.begin(), file.regions.end(), region);
  if (found == file.regions.end()) {
    throw Error(options.who +
                (file.regions.empty()
                     ? "no physical group of volumes, so none is '" + region +
                           "'; name its groups in Gmsh or write one [object.material]"
                     : "no physical group of volumes '" + region +
                           "'; write one of: " + text::joined(file.regions) + " (the nearest is " +
                           text::nearest_name(region, file.regions) + ")"));
  }
  return static_cast<std::size_t>(found - file.regions.begin());
}

void add_elements(const MeshFile& file, const MeshObjectOptions& options, SpringMesh& mesh) {
  constexpr std::int32_t kNone = -1;
  std::int32_t otherwise = kNone;
  if (options.material) {
    otherwise = 0;
    mesh.materials.push_back(*options.material);
  }
  std::vector<std::int32_t> material_of(file.regions.size(), otherwise);
  for (const RegionMaterial& each : options.region_materials) {
    material_of[region_number(file, options, each.region)] =
        static_cast<std::int32_t>(mesh.materials.size());
    mesh.materials.push_back(each.material);
  }
  for (std::size_t t = 0; t < file.tetrahedra.size(); ++t) {
    const std::int32_t region = file.region.empty() ? kNone : file.region[t];
    const std::int32_t material =
        region == kNone ? otherwise : material_of[static_cast<std::size_t>(region)];
    if (material == kNone) {
      throw Error(options.who + "tetrahedron " + std::to_string(t + 1) +
                  (region == kNone ? " is in no physical group"
                                   : " is in the physical group '" +
                                         file.regions[static_cast<std::size_t>(region)] + "'") +
                  " and has no material; add an [object.material] for all that is left, or an " +
                  "[[object.region]] for it");
    }
    mesh.tetrahedra.push_back({file.tetrahedra[t], material});
  }
}

// The tool could push a part that nothing holds away without force.
void check_held(const SpringMesh& mesh, const std::string& who) {
  std::vector<std::size_t> root(mesh.fixed.size());
  std::iota(root.begin(), root.end(), std::size_t{0});
  const auto root_of = [&root](std::int32_t vertex) {
    auto at = static_cast<std::size_t>(vertex);
    while (root[at] != at) {
      at = root[at] = root[root[at]];
    }
    return at;
  };
  for (const Spring& spring : mesh.springs) {
    root[root_of(spring.a)] = root_of(spring.b);
  }
  for (const Tetrahedron& element : mesh.tetrahedra) {
    for (const std::int32_t vertex : element.vertex) {
      root[root_of(vertex)] = root_of(element.vertex[0]);
    }
  }
  std::vector<std::uint8_t> held(root.size(), mesh.home_stiffness_N_per_m.empty() ? 0 : 1);
  bool any_free = false;
  for (std::size_t i = 0; i < root.size(); ++i) {
    any_free = any_free || mesh.fixed[i] == 0;
    if (mesh.fixed[i] != 0) {
      held[root_of(static_cast<std::int32_t>(i))] = 1;
    }
  }
  if (!any_free) {
    throw Error(who +
                "all its vertices are fixed, so nothing can move; write a smaller "
                "fixed_below_m");
  }
  for (std::size_t i = 0; i < root.size(); ++i) {
    if (held[root_of(static_cast<std::int32_t>(i))] == 0) {
      throw Error(who + "the part with vertex " + std::to_string(i + 1) +
                  " is not connected to anything fixed; join it to the rest, remove it, or "
                  "give the object a home_stiffness_N_per_m");
    }
  }
}

}  // namespace

SpringMesh make_mesh_object(const MeshFile& file, const MeshObjectOptions& options) {
  SpringMesh mesh;
  for (const Eigen::Vector3d& vertex : file.vertex) {
    mesh.rest_position_W.push_back(options.unit_m * vertex);
  }
  const Box box = box_of(mesh.rest_position_W);
  check_size(box, options);
  if (options.has_elements()) {
    check_tetrahedra(file, options.who);
  }
  const Eigen::Vector3d middle_m = 0.5 * (box.low_m + box.high_m);
  for (Eigen::Vector3d& position_W : mesh.rest_position_W) {
    mesh.fixed.push_back(position_W.z() - box.low_m.z() <= options.fixed_below_m ? 1 : 0);
    position_W -= middle_m;
  }
  mesh.triangles = file.tetrahedra.empty() ? file.triangles : outer_faces(file, options.who);
  check_sides(mesh.triangles, options.who);
  turn_outward(mesh);
  const Eigen::Vector3d above_W(0.0, 0.0, kLongest_m);
  const auto below_m = RestSurface(mesh).look(above_W).below_m;
  if (!below_m) {
    throw Error(options.who +
                "no surface above the middle of its box, where the tool would touch; " +
                "move or turn the mesh");
  }
  const Eigen::Vector3d shift_W = options.top_W - (above_W - Eigen::Vector3d(0.0, 0.0, *below_m));
  for (Eigen::Vector3d& position_W : mesh.rest_position_W) {
    position_W += shift_W;
  }
  mesh.top_W = options.top_W;
  if (options.has_elements()) {
    add_elements(file, options, mesh);
    tighten(mesh, 0.0, options.home_stiffness_N_per_m);
    check_held(mesh, options.who);
    return mesh;
  }
  std::set<std::pair<std::int32_t, std::int32_t>> edges;
  add_edges(file.triangles, edges);
  add_edges(file.tetrahedra, edges);
  for (const auto& [a, b] : edges) {
    rt::checkpoint_at(mesh.springs.size(), edges.size());
    const double random = spring_random(options.seed, mesh.springs.size());
    mesh.springs.push_back(
        {a, b, options.stiffness_N_per_m * (1.0 + options.random_spread * random)});
  }
  mesh.laws = {options.law};
  tighten(mesh, options.pre_strain, options.home_stiffness_N_per_m);
  check_held(mesh, options.who);
  return mesh;
}

}  // namespace forcegrid::simulator
