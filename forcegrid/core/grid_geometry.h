// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>

namespace forcegrid {
#pragma GCC visibility push(default)

/// A box of the workspace cut into equal cells; the vertices are the cells' corners.
struct GridGeometry {
  Eigen::Vector3d min_W = Eigen::Vector3d::Zero();  ///< [m] lowest corner
  Eigen::Vector3d max_W = Eigen::Vector3d::Zero();  ///< [m] highest corner
  /// p_x, p_y, p_z; there is one vertex more per axis.
  Eigen::Vector3i cells = Eigen::Vector3i::Zero();

  /// @throws std::invalid_argument naming the field: not finite, max <= min, or cells not in
  ///         1..4096.
  void check() const;

  Eigen::Vector3d spacing_m() const noexcept {
    return (max_W - min_W).cwiseQuotient(cells.cast<double>());
  }
  std::size_t vertex_count() const noexcept {
    return (cells.array() + 1).cast<std::size_t>().prod();
  }
  std::size_t cell_count() const noexcept { return cells.array().cast<std::size_t>().prod(); }
};

#pragma GCC visibility pop
}  // namespace forcegrid
