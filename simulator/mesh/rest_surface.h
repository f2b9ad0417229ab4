// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// The surface of an object at rest: which side of it a point is on, and where a straight path
/// meets it from outside.
///
/// If a point lies exactly on an edge or a vertex, seen from above, it counts as shifted slightly
/// toward +x, and far less toward +y. So a vertical line counts each crossing once.
/// Source: Edelsbrunner and Muecke, Simulation of simplicity, ACM Trans. Graph. 9(1), 1990.
///
/// Real-time: after construction no allocation, lock or throw; look() tests the triangles
/// of one grid cell, first_hit() all of them. Threads: any, const.
class RestSurface {
 public:
  /// Does not keep `mesh`. Without triangles there is no surface, and nothing is inside.
  explicit RestSurface(const SpringMesh& mesh);

  /// Result of a vertical line through a point.
  struct Vertical {
    bool inside = false;            ///< an odd number of triangles lies at or above the point
    std::optional<double> below_m;  ///< [m] how far below it the nearest triangle is
  };
  /// `position_W` [m] finite.
  [[nodiscard]] Vertical look(const Eigen::Vector3d& position_W) const noexcept;

  /// Where the straight path from `from_W` along `path_W` [m] first meets a triangle from outside;
  /// nothing if it meets none.
  [[nodiscard]] std::optional<Eigen::Vector3d> first_hit(
      const Eigen::Vector3d& from_W, const Eigen::Vector3d& path_W) const noexcept;

 private:
  using Triangle = std::array<std::int32_t, 3>;

  bool column_meets(const Triangle& triangle, const Eigen::Vector3d& position_W) const noexcept;

  std::vector<Eigen::Vector3d> vertex_W_;
  std::vector<Triangle> triangles_;
  // A flat grid over x and y; cell_begin_ has one entry more than cells.
  Eigen::Array2d low_W_ = Eigen::Array2d::Zero();
  Eigen::Array2d cell_m_ = Eigen::Array2d::Ones();
  Eigen::Array2i cells_ = Eigen::Array2i::Zero();
  std::vector<std::int32_t> cell_begin_;
  std::vector<std::int32_t> cell_triangle_;
};

}  // namespace forcegrid::simulator
