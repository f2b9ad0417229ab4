// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/core/buffer.h"
#include "forcegrid/core/storage_blocks.h"
#include "forcegrid/grid/force_grid.h"
#include "forcegrid/grid/grid_storage.h"

namespace forcegrid {

/// A cube of 4 x 4 x 4 blocks out of a far larger grid, for AdaptiveGrid. Each block of the grid
/// has one place in the cube, given by its numbers modulo 4. A block that is not in the cube, or
/// not yet complete there, reads as empty and can't be updated.
class WindowStorage {
 public:
  static constexpr int kBlocks = 4;  ///< per axis, a power of two

  explicit WindowStorage(const Eigen::Vector3i& vertices) noexcept;

  bool allocated() const noexcept { return segments_.allocated(); }
  std::size_t bytes() const noexcept { return segments_.bytes(); }

  const ForceSegment& segment(int i, int j, int s) const noexcept {
    return segments_[first_segment(unsigned_of(i), unsigned_of(j), unsigned_of(s)) +
                     within(unsigned_of(i), unsigned_of(j))];
  }
  ForceSegment* touch(int i, int j, int s, std::uint32_t fill, int& extra_units) noexcept {
    static_cast<void>(fill);
    static_cast<void>(extra_units);
    const std::size_t first = first_segment(unsigned_of(i), unsigned_of(j), unsigned_of(s));
    return first == kEmptyBlock ? nullptr
                                : &segments_[first + within(unsigned_of(i), unsigned_of(j))];
  }

  class Corners {
   public:
    Corners(const WindowStorage& storage, std::uint32_t i, std::uint32_t j,
            std::uint32_t k) noexcept
        : storage_(storage), i_(i), j_(j), k_(k) {}
    template <int kA, int kB, int kC>
    const ForceVertex* at() const noexcept {
      const std::uint32_t k = k_ + kC;
      return storage_
                 .segments_[storage_.first_segment(i_ + kA, j_ + kB, k / kSegmentVertices) +
                            within(i_ + kA, j_ + kB)]
                 .vertices.data() +
             k % kSegmentVertices;
    }

   private:
    const WindowStorage& storage_;
    std::uint32_t i_, j_, k_;
  };
  template <typename Use>
  auto with_corners(std::uint32_t i, std::uint32_t j, std::uint32_t k, Use use) const noexcept {
    if (all_in_one_block(i, j, k)) [[likely]] {
      return use(
          StridedCorners(segments_[first_segment(i, j, k / kSegmentVertices)].vertices.data() +
                             vertex_in_block(i, j, k),
                         kBlockVertices, kBlockVertices * kBlockVertices));
    }
    return use(Corners(*this, i, j, k));
  }

  /// Empties the cube; all its blocks are missing then.
  void restart() noexcept;
  bool ready() const noexcept { return true; }
  int tidy(int budget) noexcept {
    static_cast<void>(budget);
    return 0;
  }
  std::uint64_t recycled() const noexcept { return 0; }
  /// As BlockStorage's, for the blocks that are complete.
  template <typename Use>
  void for_each_block(Use use) const noexcept {
    constexpr std::uint64_t kMask = (1U << 20U) - 1;
    for (const std::uint64_t key : keys_) {
      if (key != kNone) {
        use(Eigen::Vector3i(kBlockVertices * Eigen::Matrix<std::uint64_t, 3, 1>(
                                                 key >> 40U, key >> 20U & kMask, key & kMask)
                                                 .cast<int>()));
      }
    }
  }

  /// Moves the cube so that its middle is the block corner nearest to the vertex (i, j, k).
  void centre_at(const Eigen::Vector3i& vertex) noexcept;

  /// Finds the block nearest to the cube's middle that belongs in the cube and is missing.
  /// @returns false if none is missing.
  bool next_missing(Eigen::Vector3i& block) const noexcept;

  /// The place of a block that is being made, which reads as empty until complete() is called.
  ForceSegment* begin_block(const Eigen::Vector3i& block) noexcept;
  void complete(const Eigen::Vector3i& block) noexcept;
  /// False once the cube has moved away.
  bool wanted(const Eigen::Vector3i& block) const noexcept;

 private:
  static constexpr std::size_t kPlaces = kBlocks * kBlocks * kBlocks;
  static constexpr std::size_t kEmptyBlock = kPlaces * kBlockSegments;  ///< behind the others
  static constexpr std::uint64_t kNone = ~std::uint64_t{0};

  static std::uint32_t unsigned_of(int index) noexcept { return static_cast<std::uint32_t>(index); }
  static std::size_t within(std::uint32_t i, std::uint32_t j) noexcept {
    return i % kBlockVertices * kBlockVertices + j % kBlockVertices;
  }
  static std::size_t place(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
    return (x % kBlocks * kBlocks + y % kBlocks) * kBlocks + z % kBlocks;
  }
  static std::uint64_t key(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
    return (std::uint64_t{x} << 40U) | (std::uint64_t{y} << 20U) | z;
  }
  std::size_t first_segment(std::uint32_t i, std::uint32_t j, std::uint32_t s) const noexcept {
    const std::uint32_t x = i / kBlockVertices;
    const std::uint32_t y = j / kBlockVertices;
    const std::size_t at = place(x, y, s);
    return keys_[at] == key(x, y, s) ? at * kBlockSegments : kEmptyBlock;
  }

  Eigen::Vector3i blocks_;                           ///< of the whole grid per axis
  Eigen::Vector3i first_ = Eigen::Vector3i::Zero();  ///< lowest block of the cube, may be negative
  std::array<std::uint64_t, kPlaces> keys_{};        ///< the block that is complete at each place
  Buffer<ForceSegment> segments_;
};

/// The paper's adaptive form: a dense grid in a cube of 32 vertices per axis that follows the tool,
/// inside a sparse one over the whole workspace whose cells are four times as long.
///
/// Each sample is spread in both. A block that enters the cube starts with the sparse grid's forces
/// and weights there, interpolated. Weights of the inverse powers, whose h differs, are scaled to
/// what the same samples would have given the dense grid at distances above its h. A block that
/// leaves the cube is forgotten; the sparse grid remains. A query uses the dense grid if it knows
/// all of the cell's vertices, else the sparse one. The tool is at least 12 dense cells from the
/// cube's border (less at the workspace's), so it meets that step only if it outruns the budget of
/// work(). Source: forcegrid paper, section 7, "high-density grid in a cube around the current
/// position of the operational point and a low-density grid in the rest". Memory: 0.5 MB for the
/// cube, and a dense grid of 1/64 of the vertices.
class AdaptiveGrid {
 public:
  static constexpr int kCoarsening = 4;

  /// @param geometry of the dense grid, as if it were everywhere. A cell that is counted is one of
  ///        the sparse grid.
  AdaptiveGrid(const GridGeometry& geometry, const RadialWeight& weighting, bool counting,
               Interpolation interpolation = Interpolation::kTrilinear,
               Instructions instructions = Instructions::kBest) noexcept;

  /// The sparse grid's cells: a quarter of the dense one's, rounded up.
  static GridGeometry sparse_geometry(const GridGeometry& geometry) noexcept;

  struct Fill {
    ForceGrid<DenseStorage<ForceSegment>>::Fill sparse;
    ForceGrid<WindowStorage>::Fill dense;
  };

  bool allocated() const noexcept { return sparse_.allocated() && dense_.allocated(); }
  std::size_t bytes() const noexcept { return sparse_.bytes() + dense_.bytes(); }
  /// Of the grid whose cells are counted.
  const GridGeometry& geometry() const noexcept { return sparse_.geometry(); }
  bool inside(const Eigen::Vector3d& position_W) const noexcept {
    return sparse_.inside(position_W);
  }
  Fill begin_fill(const Sample& sample, bool with_stiffness) noexcept {
    return {sparse_.begin_fill(sample, with_stiffness), dense_.begin_fill(sample, with_stiffness)};
  }
  int continue_fill(Fill& fill, int budget) noexcept;
  bool finished(const Fill& fill) const noexcept {
    return sparse_.finished(fill.sparse) && dense_.finished(fill.dense);
  }
  [[nodiscard]] ForceEstimate read(const Eigen::Vector3d& position_W) const noexcept;

  void restart() noexcept;
  bool ready() const noexcept { return sparse_.ready(); }
  int tidy(int budget) noexcept { return sparse_.tidy(budget); }
  Eigen::Vector3i cell(const Eigen::Vector3d& position_W) const noexcept {
    return sparse_.cell(position_W);
  }
  std::uint16_t samples_in(const Eigen::Vector3i& cell) const noexcept {
    return sparse_.samples_in(cell);
  }
  void count_sample_in(const Eigen::Vector3i& cell) noexcept { sparse_.count_sample_in(cell); }
  std::uint64_t recycled() const noexcept { return 0; }
  /// Of the cube: the sparse grid is everywhere.
  std::size_t storage_blocks(std::span<StorageBlock> blocks) const noexcept {
    return dense_.storage_blocks(blocks);
  }

  /// Moves the cube to the tool; a position outside or not finite leaves it where it is.
  void follow(const Eigen::Vector3d& position_W) noexcept;

  /// Makes missing blocks of the cube from the sparse grid, at most `budget` vertices rounded up to
  /// a segment. Do not call it during a fill: its sample would count twice.
  /// @returns the units done, 0 if no block is missing.
  int prepare(int budget) noexcept;
  /// Whether a block is half made: prepare() must continue before the next fill.
  bool preparing() const noexcept { return next_segment_ > 0; }

  const ForceGrid<WindowStorage>& dense() const noexcept { return dense_; }
  const ForceGrid<DenseStorage<ForceSegment>>& sparse() const noexcept { return sparse_; }

 private:
  ForceGrid<DenseStorage<ForceSegment>> sparse_;
  ForceGrid<WindowStorage> dense_;
  float inherited_share_;  ///< of the sparse grid's weight for the dense one
  Eigen::Vector3i block_ = Eigen::Vector3i::Zero();  ///< the one being made
  int next_segment_ = 0;                             ///< of it; 0: none is being made
};

}  // namespace forcegrid
