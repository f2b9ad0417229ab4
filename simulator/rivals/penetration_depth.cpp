// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/penetration_depth.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <utility>

#include "simulator/mesh/error.h"
#include "simulator/rivals/rest_model.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

// The unit normal of the surface within the patch around `point_W`, or of the nearest facet; zero
// if there is none near.
Vector3d surface_normal_W(const PenetrationTable& table, const Vector3d& point_W) noexcept {
  Vector3d sum_W = Vector3d::Zero();
  Vector3d nearest_W = Vector3d::Zero();
  double nearest_m = std::numeric_limits<double>::infinity();
  for (const PenetrationTable::Facet& facet : table.facets) {
    const double away_m = (facet.centre_W - point_W).norm();
    if (away_m <= table.patch_radius_m) {
      sum_W += facet.area_W;
    }
    if (away_m < nearest_m) {
      nearest_m = away_m;
      nearest_W = facet.area_W;
    }
  }
  if (nearest_m > table.patch_radius_m + table.longest_edge_m) {
    return Vector3d::Zero();
  }
  const double size_m2 = sum_W.norm();
  return size_m2 > 0.0 ? Vector3d(sum_W / size_m2) : Vector3d(nearest_W.normalized());
}

}  // namespace

std::shared_ptr<const PenetrationTable> make_penetration_table(const SpringMesh& mesh,
                                                               double patch_radius_m) {
  check(mesh);
  check_positive(patch_radius_m, "penetration-depth: patch_radius_m");
  auto table = std::make_shared<PenetrationTable>();
  table->patch_radius_m = patch_radius_m;
  for (const auto& triangle : mesh.triangles) {
    const Vector3d& a = mesh.rest_position_W[static_cast<std::size_t>(triangle[0])];
    const Vector3d& b = mesh.rest_position_W[static_cast<std::size_t>(triangle[1])];
    const Vector3d& c = mesh.rest_position_W[static_cast<std::size_t>(triangle[2])];
    table->facets.push_back({(a + b + c) / 3.0, 0.5 * (b - a).cross(c - a)});
    table->longest_edge_m =
        std::max({table->longest_edge_m, (b - a).norm(), (c - b).norm(), (a - c).norm()});
  }
  const Vector3d normal_W = surface_normal_W(*table, mesh.top_W);
  if (normal_W.isZero()) {
    throw Error(
        "penetration-depth: the object has no surface at its top, so a depth has no direction; "
        "give the mesh triangles there");
  }
  const std::vector<std::int32_t> patch = vertices_within(mesh, mesh.top_W, patch_radius_m);
  if (patch.empty()) {
    throw Error("penetration-depth: no free vertex within " + std::to_string(patch_radius_m) +
                " m of the object's top; use a larger grip");
  }
  table->stiffness_N_per_m = -normal_W.dot(rest_stiffness_W(mesh, patch) * normal_W);
  return table;
}

PenetrationDepthMethod::PenetrationDepthMethod(std::shared_ptr<const PenetrationTable> table)
    : table_(std::move(table)) {}

std::size_t PenetrationDepthMethod::memory_bytes() const noexcept {
  return sizeof *this + sizeof *table_ +
         table_->facets.capacity() * sizeof(PenetrationTable::Facet);
}

bool PenetrationDepthMethod::hold(const Vector3d& point_W) noexcept {
  normal_W_ = surface_normal_W(*table_, point_W);
  return normal_W_.squaredNorm() > 0.0;
}

Vector3d PenetrationDepthMethod::response_N(const Vector3d& displacement_W) const noexcept {
  return -table_->stiffness_N_per_m * normal_W_.dot(displacement_W) * normal_W_;
}

}  // namespace forcegrid::simulator
