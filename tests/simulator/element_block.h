// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <random>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A box of nx * ny * nz cells of `edge_m`, six tetrahedra each (Kuhn's division), its top centre
/// at the origin and its bottom fixed. Inner vertices are moved at random by up to `jitter` of an
/// edge.
inline SpringMesh element_block(const std::array<int, 3>& cells, double edge_m,
                                const ElementMaterial& material, double jitter = 0.0,
                                unsigned seed = 1) {
  SpringMesh mesh;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> shift(-jitter * edge_m, jitter * edge_m);
  const auto number = [&cells](int x, int y, int z) {
    return x + (cells[0] + 1) * (y + (cells[1] + 1) * z);
  };
  for (int z = 0; z <= cells[2]; ++z) {
    for (int y = 0; y <= cells[1]; ++y) {
      for (int x = 0; x <= cells[0]; ++x) {
        Eigen::Vector3d place_W(edge_m * (x - 0.5 * cells[0]), edge_m * (y - 0.5 * cells[1]),
                                edge_m * (z - cells[2]));
        const bool inner = x > 0 && x < cells[0] && y > 0 && y < cells[1] && z > 0 && z < cells[2];
        const Eigen::Vector3d by_W(shift(random), shift(random), shift(random));
        mesh.rest_position_W.emplace_back(inner ? Eigen::Vector3d(place_W + by_W) : place_W);
        mesh.fixed.push_back(z == 0 ? 1 : 0);
      }
    }
  }
  for (int z = 0; z < cells[2]; ++z) {
    for (int y = 0; y < cells[1]; ++y) {
      for (int x = 0; x < cells[0]; ++x) {
        std::array<int, 3> axes{0, 1, 2};
        do {  // from one corner to the opposite one along each order of the axes
          std::array<int, 3> at{x, y, z};
          Tetrahedron element;
          element.vertex[0] = number(at[0], at[1], at[2]);
          for (std::size_t k = 0; k < 3; ++k) {
            ++at[static_cast<std::size_t>(axes[k])];
            element.vertex[k + 1] = number(at[0], at[1], at[2]);
          }
          mesh.tetrahedra.push_back(element);
        } while (std::next_permutation(axes.begin(), axes.end()));
      }
    }
  }
  mesh.materials = {material};
  return mesh;
}

inline ElementMaterial soft(ElementModel model, double poissons_ratio = 0.3) {
  return {.model = model,
          .youngs_modulus_Pa = 5e3,
          .poissons_ratio = poissons_ratio,
          .density_kg_per_m3 = 1000.0};
}

inline constexpr std::array<ElementModel, 3> kElementModels{
    ElementModel::kCorotated, ElementModel::kStVenantKirchhoff, ElementModel::kNeoHookean};

}  // namespace forcegrid::simulator
