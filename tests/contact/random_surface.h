// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "contact/surface_tree.h"

namespace forcegrid::contact {

inline Eigen::Vector3d random_vector(std::mt19937_64& random, double scale) {
  std::uniform_real_distribution<double> uniform(-scale, scale);
  const double x = uniform(random);
  const double y = uniform(random);
  return {x, y, uniform(random)};
}

struct Surface {
  std::vector<SurfaceTree::Triangle> triangles;
  std::vector<Eigen::Vector3d> positions_W;

  SurfaceTree tree() const { return SurfaceTree(triangles, positions_W); }
};

// (n + 1)^2 vertices over a square of `side_m` around the origin, triangles seen from above.
inline Surface flat_surface(std::int32_t n, double side_m) {
  Surface surface;
  for (std::int32_t j = 0; j <= n; ++j) {
    for (std::int32_t i = 0; i <= n; ++i) {
      surface.positions_W.emplace_back(side_m * (i / static_cast<double>(n) - 0.5),
                                       side_m * (j / static_cast<double>(n) - 0.5), 0.0);
    }
  }
  for (std::int32_t j = 0; j < n; ++j) {
    for (std::int32_t i = 0; i < n; ++i) {
      const std::int32_t low = i + (n + 1) * j;
      const std::int32_t high = low + n + 1;
      surface.triangles.push_back({low, low + 1, high + 1});
      surface.triangles.push_back({low, high + 1, high});
    }
  }
  return surface;
}

inline void displace(Surface& surface, std::mt19937_64& random, double scale_m) {
  for (Eigen::Vector3d& position_W : surface.positions_W) {
    position_W += random_vector(random, scale_m);
  }
}

// A tool of every kind, of sizes that have something to meet on a surface of 0.1 m.
inline ToolShape random_tool(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const double radius_m = 0.001 + 0.01 * uniform(random);
  switch (random() % 3) {
    case 0:
      return ToolShape::sphere(radius_m);
    case 1:
      return ToolShape::capsule(radius_m, 0.05 * uniform(random), random_vector(random, 1.0));
    default:
      return ToolShape::grasper(radius_m, radius_m + 0.03 * uniform(random), uniform(random));
  }
}

}  // namespace forcegrid::contact
