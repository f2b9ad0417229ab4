// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "forcegrid/core/buffer.h"
#include "forcegrid/core/storage_blocks.h"
#include "forcegrid/grid/grid_segments.h"

namespace forcegrid {

/// The eight vertices around a cell, where vertices along each axis are a fixed distance apart in
/// memory.
template <typename Vertex>
class StridedCorners {
 public:
  StridedCorners(const Vertex* lowest, std::size_t row, std::size_t slab) noexcept
      : lowest_(lowest), row_(row), slab_(slab) {}
  template <int kA, int kB, int kC>
  const Vertex* at() const noexcept {
    return lowest_ + (kA * slab_ + kB * row_ + kC);
  }

 private:
  const Vertex* lowest_;
  std::size_t row_, slab_;  ///< vertices from one to the next along y, and along x
};

/// Where a grid's vertices live. A storage holds segments of eight vertices along z and, if cells
/// are counted, one counter per vertex: that of the cell of which it is the lowest corner. Every
/// storage has the functions of DenseStorage, with the same meaning.
/// Real-time: only constructors allocate; nothing locks or throws. Threads: one.

/// One array over the whole box, and a second one that is cleared while the first is in use, so
/// that a new contact starts on a clean grid at once. Memory: two segments per eight vertices.
template <typename Segment>
class DenseStorage {
 public:
  /// @param vertices per axis.
  /// @param counting whether counters are kept.
  DenseStorage(const Eigen::Vector3i& vertices, bool counting) noexcept
      : row_(segments_in_row(vertices)), slab_(row_ * static_cast<std::size_t>(vertices.y())) {
    const std::size_t all = slab_ * static_cast<std::size_t>(vertices.x());
    for (std::size_t half = 0; half < 2; ++half) {
      segments_[half] = Buffer<Segment>(all, Segment{});
      counters_[half] = Buffer<Counters>(counting ? all : 0, Counters{});
    }
    spare_clean_to_ = all;
    use(0);
  }

  /// The size of such a storage in bytes.
  static double bytes_for(const Eigen::Vector3i& vertices, bool counting) noexcept {
    return 2.0 * static_cast<double>(segments_in_row(vertices)) * vertices.y() * vertices.x() *
           static_cast<double>(sizeof(Segment) + (counting ? sizeof(Counters) : 0));
  }

  bool allocated() const noexcept {
    return segments_[0].allocated() && segments_[1].allocated() && counters_[0].allocated() &&
           counters_[1].allocated();
  }
  std::size_t bytes() const noexcept { return 2 * (segments_[0].bytes() + counters_[0].bytes()); }

  /// The segment `s` of the row of vertices (i, j), for reading.
  const Segment& segment(int i, int j, int s) const noexcept { return active_[index(i, j, s)]; }

  /// The same for updating by the fill of this number; null if it can't be updated.
  /// @param extra_units grows by its cost beyond the lookup.
  Segment* touch(int i, int j, int s, std::uint32_t fill, int& extra_units) noexcept {
    static_cast<void>(fill);
    static_cast<void>(extra_units);
    return &active_[index(i, j, s)];
  }

  std::uint16_t counter(int i, int j, int k) const noexcept {
    return counters_[half_][index(i, j, k / kSegmentVertices)][lane(k)];
  }
  std::uint16_t* touch_counter(int i, int j, int k, std::uint32_t fill) noexcept {
    static_cast<void>(fill);
    return &counters_[half_][index(i, j, k / kSegmentVertices)][lane(k)];
  }

  /// Calls `use` with the eight vertices around the cell (i, j, k), for reading: an object whose
  /// at<a, b, c>() points at the vertex (i + a, j + b, k + c).
  template <typename Use>
  auto with_corners(std::uint32_t i, std::uint32_t j, std::uint32_t k,
                    Use use) const noexcept requires requires {
    typename Segment::Vertex;
  }
  {
    const std::size_t row = row_ * kSegmentVertices;
    const std::size_t slab = slab_ * kSegmentVertices;
    return use(StridedCorners<typename Segment::Vertex>(
        active_->vertices.data() + (i * slab + j * row + k), row, slab));
  }

  /// Forgets everything. If the other array is still being cleared, this one is not ready() yet.
  void restart() noexcept {
    if (!ready_) {
      return;  // the contact before still waits for its clean array; so does this one
    }
    ready_ = spare_clean_to_ == segments_[0].size();
    use(1 - half_);
    if (ready_) {
      spare_clean_to_ = 0;
    }
  }

  /// False while the array in use has not been cleared; then it must not be read or filled.
  bool ready() const noexcept { return ready_; }

  /// Clears the remainder, at most `budget` vertices rounded up to a segment.
  /// @returns the units done.
  int tidy(int budget) noexcept {
    const std::size_t all = segments_[0].size();
    const std::size_t wanted =
        static_cast<std::size_t>((std::max(budget, 0) + kSegmentVertices - 1) / kSegmentVertices);
    const std::size_t count = std::min(wanted, all - spare_clean_to_);
    const std::size_t half = ready_ ? 1 - half_ : half_;
    std::fill_n(segments_[half].data() + spare_clean_to_, count, Segment{});
    if (counters_[half].size() > 0) {
      std::fill_n(counters_[half].data() + spare_clean_to_, count, Counters{});
    }
    spare_clean_to_ += count;
    if (!ready_ && spare_clean_to_ == all) {
      ready_ = true;
      spare_clean_to_ = 0;  // the other half, of an earlier contact
    }
    return static_cast<int>(count) * kSegmentVertices;
  }

  /// Parts recycled for lack of room: none here.
  std::uint64_t recycled() const noexcept { return 0; }

 private:
  using Counters = std::array<std::uint16_t, kSegmentVertices>;

  static std::size_t segments_in_row(const Eigen::Vector3i& vertices) noexcept {
    return static_cast<std::size_t>((vertices.z() + kSegmentVertices - 1) / kSegmentVertices);
  }
  static std::size_t lane(int k) noexcept { return static_cast<std::size_t>(k % kSegmentVertices); }
  std::size_t index(int i, int j, int s) const noexcept {
    return static_cast<std::size_t>(i) * slab_ + static_cast<std::size_t>(j) * row_ +
           static_cast<std::size_t>(s);
  }
  void use(std::size_t half) noexcept {
    half_ = half;
    active_ = segments_[half].data();
  }

  std::size_t row_, slab_;  ///< segments from one row to the next along y, and along x
  Segment* active_ = nullptr;
  std::size_t half_ = 0;  ///< the array in use
  std::array<Buffer<Segment>, 2> segments_;
  std::array<Buffer<Counters>, 2> counters_;
  std::size_t spare_clean_to_ = 0;  ///< segments of the array being cleared that are clean
  bool ready_ = true;
};

/// Vertices along each edge of a block, a power of two.
inline constexpr int kBlockVertices = 8;
/// Segments of a block: 8 x 8 rows of one segment each.
inline constexpr int kBlockSegments = kBlockVertices * kBlockVertices;

/// Whether the vertices around the cell (i, j, k) are all in the block of the first, as for two
/// cells out of three.
inline bool all_in_one_block(std::uint32_t i, std::uint32_t j, std::uint32_t k) noexcept {
  constexpr std::uint32_t kLast = kBlockVertices - 1;
  return (((i & kLast) + 1) | ((j & kLast) + 1) | ((k & kLast) + 1)) < kBlockVertices;
}
/// The vertex (i, j, k) counted within its block.
inline std::size_t vertex_in_block(std::uint32_t i, std::uint32_t j, std::uint32_t k) noexcept {
  return (i % kBlockVertices * kBlockVertices + j % kBlockVertices) * kBlockVertices +
         k % kBlockVertices;
}

/// The blocks of a storage in use as boxes, see StorageBlocks::storage_blocks(). A block holds the
/// cells of which its vertices are the lowest corners.
/// @param low_W     [m] the grid's first vertex
/// @param spacing_m  of the vertices, per axis
/// @param cells      of the grid, per axis
template <typename Storage>
std::size_t boxes_of_blocks(const Storage& storage, const Eigen::Vector3d& low_W,
                            const Eigen::Vector3d& spacing_m, const Eigen::Vector3i& cells,
                            std::span<StorageBlock> boxes) noexcept {
  std::size_t count = 0;
  storage.for_each_block([&](const Eigen::Vector3i& first_vertex) {
    if (count < boxes.size()) {
      const Eigen::Array3i end = (first_vertex.array() + kBlockVertices).min(cells.array());
      boxes[count] = {low_W + spacing_m.cwiseProduct(first_vertex.cast<double>()),
                      low_W + spacing_m.cwiseProduct(end.matrix().cast<double>())};
    }
    ++count;
  });
  return count;
}

/// Blocks of 8 x 8 x 8 vertices from a fixed pool, taken when a sample first reaches them. All
/// others read as empty. Memory: the pool, and 4 bytes per block of the whole box.
///
/// If the pool is used up, the block that no sample has reached for the longest time is emptied and
/// reused, and counted in recycled(). The pool must hold the blocks of one fill.
template <typename Segment>
class BlockStorage {
 public:
  BlockStorage(const Eigen::Vector3i& vertices, bool counting, std::size_t pool_blocks) noexcept
      : row_(blocks_along(vertices.z())),
        slab_(row_ * blocks_along(vertices.y())),
        directory_(slab_ * blocks_along(vertices.x()), 0U),
        segments_((pool_blocks + 1) * kBlockSegments, Segment{}),
        counters_(counting ? (pool_blocks + 1) * kBlockSegments : 0, Counters{}),
        blocks_(pool_blocks + 1, Block{}) {}

  static double bytes_for(const Eigen::Vector3i& vertices, bool counting,
                          std::size_t pool_blocks) noexcept {
    return static_cast<double>(block_count(vertices)) * sizeof(std::uint32_t) +
           static_cast<double>(pool_blocks + 1) *
               static_cast<double>(sizeof(Block) +
                                   kBlockSegments *
                                       (sizeof(Segment) + (counting ? sizeof(Counters) : 0)));
  }
  static std::size_t block_count(const Eigen::Vector3i& vertices) noexcept {
    return blocks_along(vertices.x()) * blocks_along(vertices.y()) * blocks_along(vertices.z());
  }

  bool allocated() const noexcept {
    return directory_.allocated() && segments_.allocated() && counters_.allocated() &&
           blocks_.allocated();
  }
  std::size_t bytes() const noexcept {
    return directory_.bytes() + segments_.bytes() + counters_.bytes() + blocks_.bytes();
  }
  std::size_t blocks_in_use() const noexcept { return used_; }
  /// Calls `use` with the lowest vertex (i, j, k) of each block in use.
  template <typename Use>
  void for_each_block(Use use) const noexcept {
    for (std::size_t block = 1; block <= used_; ++block) {
      const std::size_t place = blocks_[block].place;
      use(Eigen::Vector3i(kBlockVertices * Eigen::Matrix<std::size_t, 3, 1>(
                                               place / slab_, place % slab_ / row_, place % row_)
                                               .cast<int>()));
    }
  }

  const Segment& segment(int i, int j, int s) const noexcept {
    return segments_[first_segment(directory_[block_at(i, j, s)]) + within(i, j)];
  }

  Segment* touch(int i, int j, int s, std::uint32_t fill, int& extra_units) noexcept {
    const std::uint32_t block = take(block_at(i, j, s), fill, extra_units);
    return &segments_[first_segment(block) + within(i, j)];
  }

  std::uint16_t counter(int i, int j, int k) const noexcept {
    const std::uint32_t block = directory_[block_at(i, j, k / kSegmentVertices)];
    return counters_[first_segment(block) + within(i, j)][lane(k)];
  }
  std::uint16_t* touch_counter(int i, int j, int k, std::uint32_t fill) noexcept {
    int units = 0;
    const std::uint32_t block = take(block_at(i, j, k / kSegmentVertices), fill, units);
    return &counters_[first_segment(block) + within(i, j)][lane(k)];
  }

  // Neighbours may lie in up to eight blocks; their places are computed axis by axis.
  template <typename Vertex>
  class Corners {
   public:
    Corners(const Vertex* pool, const std::uint32_t* directory, std::size_t row, std::size_t slab,
            std::uint32_t i, std::uint32_t j, std::uint32_t k) noexcept
        : pool_(pool), directory_(directory) {
      for (std::uint32_t step = 0; step < 2; ++step) {
        block_x_[step] = ((i + step) / kBlockVertices) * slab;
        block_y_[step] = ((j + step) / kBlockVertices) * row;
        block_z_[step] = (k + step) / kBlockVertices;
        in_x_[step] = ((i + step) % kBlockVertices) * (kBlockVertices * kBlockVertices);
        in_y_[step] = ((j + step) % kBlockVertices) * kBlockVertices;
        in_z_[step] = (k + step) % kBlockVertices;
      }
    }
    template <int kA, int kB, int kC>
    const Vertex* at() const noexcept {
      const std::size_t block = directory_[block_x_[kA] + block_y_[kB] + block_z_[kC]];
      return pool_ +
             (block * (kBlockSegments * kSegmentVertices) + in_x_[kA] + in_y_[kB] + in_z_[kC]);
    }

   private:
    const Vertex* pool_;
    const std::uint32_t* directory_;
    std::array<std::size_t, 2> block_x_, block_y_, block_z_, in_x_, in_y_, in_z_;
  };
  template <typename Use>
  auto with_corners(std::uint32_t i, std::uint32_t j, std::uint32_t k,
                    Use use) const noexcept requires requires {
    typename Segment::Vertex;
  }
  {
    if (all_in_one_block(i, j, k)) [[likely]] {
      const std::size_t block = directory_[(i / kBlockVertices) * slab_ +
                                           (j / kBlockVertices) * row_ + k / kBlockVertices];
      return use(StridedCorners<typename Segment::Vertex>(
          segments_.data()->vertices.data() +
              (block * (kBlockSegments * kSegmentVertices) + vertex_in_block(i, j, k)),
          kBlockVertices, kBlockVertices * kBlockVertices));
    }
    return use(Corners<typename Segment::Vertex>(segments_.data()->vertices.data(),
                                                 directory_.data(), row_, slab_, i, j, k));
  }

  /// Takes time in proportion to the blocks in use, about 2 ns each.
  void restart() noexcept {
    for (std::size_t block = 1; block <= used_; ++block) {
      directory_[blocks_[block].place] = 0;
    }
    used_ = 0;
    newest_ = oldest_ = 0;
  }
  bool ready() const noexcept { return true; }
  int tidy(int budget) noexcept {
    static_cast<void>(budget);
    return 0;  // a block is cleared when it is taken
  }
  std::uint64_t recycled() const noexcept { return recycled_; }

 private:
  using Counters = std::array<std::uint16_t, kSegmentVertices>;
  static_assert(kBlockVertices == kSegmentVertices);

  /// A block of the pool, in the list from the newest to the oldest. Number 0, never in the list,
  /// is the empty block that stands for all missing ones.
  struct Block {
    std::uint32_t newer = 0, older = 0;
    std::uint32_t fill = 0;   ///< the last one that reached it
    std::uint32_t place = 0;  ///< in the directory
  };

  static std::size_t blocks_along(int vertices) noexcept {
    return static_cast<std::size_t>((vertices + kBlockVertices - 1) / kBlockVertices);
  }
  static std::size_t lane(int k) noexcept { return static_cast<std::size_t>(k % kSegmentVertices); }
  static std::size_t first_segment(std::uint32_t block) noexcept {
    return static_cast<std::size_t>(block) * kBlockSegments;
  }
  static std::size_t within(int i, int j) noexcept {
    return static_cast<std::size_t>(i % kBlockVertices * kBlockVertices + j % kBlockVertices);
  }
  std::size_t block_at(int i, int j, int s) const noexcept {
    return static_cast<std::size_t>(i / kBlockVertices) * slab_ +
           static_cast<std::size_t>(j / kBlockVertices) * row_ + static_cast<std::size_t>(s);
  }

  // The block at a place of the directory, taken from the pool if it is not there yet.
  std::uint32_t take(std::size_t place, std::uint32_t fill, int& extra_units) noexcept {
    std::uint32_t block = directory_[place];
    if (block != 0 && blocks_[block].fill == fill) {
      return block;
    }
    if (block != 0) {
      unlink(block);
    } else {
      if (used_ + 1 < blocks_.size()) {
        block = static_cast<std::uint32_t>(++used_);
      } else {
        block = oldest_;
        directory_[blocks_[block].place] = 0;
        unlink(block);
        ++recycled_;
      }
      std::fill_n(segments_.data() + first_segment(block), kBlockSegments, Segment{});
      if (counters_.size() > 0) {
        std::fill_n(counters_.data() + first_segment(block), kBlockSegments, Counters{});
      }
      // Clearing two bytes costs about 1/64 of updating one vertex of 16 bytes.
      extra_units += static_cast<int>(sizeof(Segment) / 2);
      directory_[place] = block;
      blocks_[block].place = static_cast<std::uint32_t>(place);
    }
    blocks_[block].fill = fill;
    link_as_newest(block);
    return block;
  }
  void unlink(std::uint32_t block) noexcept {
    const Block& b = blocks_[block];
    (b.newer != 0 ? blocks_[b.newer].older : newest_) = b.older;
    (b.older != 0 ? blocks_[b.older].newer : oldest_) = b.newer;
  }
  void link_as_newest(std::uint32_t block) noexcept {
    blocks_[block].newer = 0;
    blocks_[block].older = newest_;
    (newest_ != 0 ? blocks_[newest_].newer : oldest_) = block;
    newest_ = block;
  }

  std::size_t row_, slab_;           ///< blocks from one to the next along y, and along x
  Buffer<std::uint32_t> directory_;  ///< the pool's block at each place, 0 where there is none
  Buffer<Segment> segments_;
  Buffer<Counters> counters_;
  Buffer<Block> blocks_;
  std::size_t used_ = 0;
  std::uint32_t newest_ = 0, oldest_ = 0;
  std::uint64_t recycled_ = 0;
};

}  // namespace forcegrid
