// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>

namespace forcegrid {
#pragma GCC visibility push(default)

/// A part of the workspace for which a method holds storage: a box of grid cells. It is flat where
/// it holds the last vertices of the grid alone.
struct StorageBlock {
  Eigen::Vector3d low_W = Eigen::Vector3d::Zero();   ///< [m] corner with the smallest coordinates
  Eigen::Vector3d high_W = Eigen::Vector3d::Zero();  ///< [m] corner with the largest
};

/// What a ForceMethod is, too, if it has storage only in parts of the workspace; for pictures.
class StorageBlocks {
 public:
  /// Writes the blocks in use, in no order, as many as there is room for in `blocks`.
  /// @returns how many are in use, which may be more than blocks.size().
  /// Real-time: no allocation, lock or throw; time in proportion to the blocks in use. Threads: as
  /// the method's other functions.
  virtual std::size_t storage_blocks(std::span<StorageBlock> blocks) const noexcept = 0;

 protected:
  ~StorageBlocks() = default;
};

#pragma GCC visibility pop
}  // namespace forcegrid
