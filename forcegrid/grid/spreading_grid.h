// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "forcegrid/core/buffer.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/grid_geometry.h"
#include "forcegrid/core/radial_weight.h"
#include "forcegrid/core/storage_blocks.h"
#include "forcegrid/grid/grid_segments.h"
#include "forcegrid/grid/grid_storage.h"
#include "forcegrid/grid/spread_kernels.h"

namespace forcegrid {

/// How far a fill reaches from the vertex nearest to its sample, vertices per axis: a sample lies
/// within half a cell's diagonal of that vertex, so what is within r of the sample is within r plus
/// half a diagonal of it.
/// @param largest_reach vertices per axis beyond which a fill need not reach.
Eigen::Vector3i fill_reach(const GridGeometry& geometry, double influence_radius_m,
                           int largest_reach) noexcept;

/// Segments around a vertex in the order in which a fill visits them, nearest first. The segment
/// offset is counted from the segment that the vertex itself is in.
struct NeighbourSegment {
  std::int16_t di = 0, dj = 0, ds = 0;
};
Buffer<NeighbourSegment> neighbour_segments(const GridGeometry& geometry, double influence_radius_m,
                                            int largest_reach) noexcept;

/// One sample on its way into a grid.
struct GridFill {
  SpreadSample sample;
  Eigen::Vector3f from_nearest_vertex_m = Eigen::Vector3f::Zero();
  Eigen::Vector3i nearest_vertex = Eigen::Vector3i::Zero();
  std::size_t next = 0;  ///< entry of the table of neighbours that comes next
  std::uint32_t number = 0;
};

/// A regular grid in which samples are spread over the vertices around them, a bounded number of
/// vertices at a time. Derived classes define what a vertex holds and how it is read. Real-time:
/// only the constructor allocates; nothing locks or throws. Threads: one.
template <typename Storage, typename Segment>
class SpreadingGrid {
 public:
  /// False when there was not enough memory; the grid is then of no use.
  bool allocated() const noexcept { return storage_.allocated() && neighbours_.allocated(); }
  /// Bytes allocated: vertices and the table of neighbours.
  std::size_t bytes() const noexcept { return storage_.bytes() + neighbours_.bytes(); }
  const GridGeometry& geometry() const noexcept { return geometry_; }

  using Fill = GridFill;

  bool inside(const Eigen::Vector3d& position_W) const noexcept {
    const Eigen::Array3d u = index_position(position_W);
    return (u >= 0.0).all() && (u <= geometry_.cells.cast<double>().array()).all();
  }

  /// Prepares to spread a sample over all vertices within r; its position must be inside().
  /// `with_stiffness`: spreads F + J (v - P) instead of F.
  Fill begin_fill(const Sample& sample, bool with_stiffness) noexcept {
    Fill fill;
    const Eigen::Array3d u = index_position(sample.position_W);
    const Eigen::Array3d nearest = (u + 0.5).floor();
    fill.nearest_vertex = nearest.cast<int>().min(geometry_.cells.array());
    fill.from_nearest_vertex_m =
        ((u - fill.nearest_vertex.cast<double>().array()) * spacing_m_.array()).cast<float>();
    Eigen::Map<Eigen::Vector3f>(fill.sample.force_W_N.data()) = sample.force_W.cast<float>();
    fill.sample.has_stiffness = with_stiffness;
    if (with_stiffness) {
      Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(
          fill.sample.stiffness_W_N_per_m.data()) = sample.stiffness_W.cast<float>();
    }
    fill.number = ++fills_;
    return fill;
  }

  /// Updates vertices, nearest first to within a segment and a cell's diagonal, until `budget`
  /// units are spent or the fill is finished. A segment costs eight units, or one if it turns out
  /// to be out of reach; at most one segment exceeds the budget. Each vertex changes in one step,
  /// so any query in between is consistent.
  /// @returns the units done.
  int continue_fill(Fill& fill, int budget) noexcept {
    std::array<SegmentWork<Segment>, kBatch> batch;
    std::size_t waiting = 0;
    int done = 0;
    const auto hand_over = [&] {
      kernel_(constants_, fill.sample, batch.data(), waiting);
      waiting = 0;
    };
    const Eigen::Array3i& last = last_segment_;
    const int nearest_segment = fill.nearest_vertex.z() / kSegmentVertices;
    const float x_step_m = static_cast<float>(spacing_m_.x());
    const float y_step_m = static_cast<float>(spacing_m_.y());
    const float z_step_m = constants_.spacing_z_m;
    while (done < budget && fill.next < neighbours_.size()) {
      const NeighbourSegment& neighbour = neighbours_[fill.next++];
      ++done;
      const int i = fill.nearest_vertex.x() + neighbour.di;
      const int j = fill.nearest_vertex.y() + neighbour.dj;
      const int s = nearest_segment + neighbour.ds;
      // Unsigned, so that one comparison finds both what is below and what is above.
      if (static_cast<unsigned>(i) > static_cast<unsigned>(last[0]) ||
          static_cast<unsigned>(j) > static_cast<unsigned>(last[1]) ||
          static_cast<unsigned>(s) > static_cast<unsigned>(last[2])) {
        continue;
      }
      const float x = static_cast<float>(neighbour.di) * x_step_m - fill.from_nearest_vertex_m.x();
      const float y = static_cast<float>(neighbour.dj) * y_step_m - fill.from_nearest_vertex_m.y();
      const float z =
          static_cast<float>(s * kSegmentVertices - fill.nearest_vertex.z()) * z_step_m -
          fill.from_nearest_vertex_m.z();
      const float from_z = std::max({z, -(z + (kSegmentVertices - 1) * z_step_m), 0.0F});
      if (x * x + y * y + from_z * from_z >= constants_.radius2_m2) {
        continue;
      }
      Segment* const segment = storage_.touch(i, j, s, fill.number, done);
      if (segment == nullptr) {
        continue;
      }
      done += kSegmentVertices - 1;
      batch[waiting++] = {segment, x, y, z};
      if (waiting == kBatch) {
        hand_over();
      }
    }
    if (waiting > 0) {
      hand_over();
    }
    return done;
  }
  bool finished(const Fill& fill) const noexcept { return fill.next >= neighbours_.size(); }

  /// Forgets everything; see the storage.
  void restart() noexcept { storage_.restart(); }
  bool ready() const noexcept { return storage_.ready(); }
  int tidy(int budget) noexcept { return storage_.tidy(budget); }

  /// The cell that holds `position_W`, which must be inside(); upper borders belong to the last.
  Eigen::Vector3i cell(const Eigen::Vector3d& position_W) const noexcept {
    const Eigen::Array3d u = index_position(position_W);
    return u.cast<int>().max(0).min(geometry_.cells.array() - 1);
  }
  /// Samples counted in a cell, for a grid that counts.
  std::uint16_t samples_in(const Eigen::Vector3i& cell) const noexcept {
    return storage_.counter(cell.x(), cell.y(), cell.z());
  }
  void count_sample_in(const Eigen::Vector3i& cell) noexcept {
    std::uint16_t& count = *storage_.touch_counter(cell.x(), cell.y(), cell.z(), fills_);
    count = static_cast<std::uint16_t>(std::min(count + 1, 0xFFFF));
  }

  std::uint64_t recycled() const noexcept { return storage_.recycled(); }
  /// See StorageBlocks; none for a storage that is everywhere.
  std::size_t storage_blocks(std::span<StorageBlock> blocks) const noexcept {
    if constexpr (requires { storage_.for_each_block([](const Eigen::Vector3i&) {}); }) {
      return boxes_of_blocks(storage_, geometry_.min_W, spacing_m_, geometry_.cells, blocks);
    } else {
      static_cast<void>(blocks);
      return 0;
    }
  }
  const Storage& storage() const noexcept { return storage_; }
  Storage& storage() noexcept { return storage_; }

 protected:
  SpreadingGrid(const GridGeometry& geometry, const RadialWeight& weighting, int largest_reach,
                SpreadKernel<Segment> kernel, Storage&& storage) noexcept
      : geometry_(geometry),
        spacing_m_(geometry.spacing_m()),
        inverse_spacing_per_m_(spacing_m_.cwiseInverse()),
        last_segment_(geometry.cells.x(), geometry.cells.y(),
                      geometry.cells.z() / kSegmentVertices),
        constants_(spread_constants(weighting, spacing_m_.z())),
        kernel_(kernel),
        neighbours_(neighbour_segments(geometry, weighting.influence_radius_m, largest_reach)),
        storage_(std::move(storage)) {}

  /// The position counted in cells from the lowest corner, axis by axis.
  Eigen::Array3d index_position(const Eigen::Vector3d& position_W) const noexcept {
    return (position_W - geometry_.min_W).cwiseProduct(inverse_spacing_per_m_);
  }

  GridGeometry geometry_;
  Eigen::Vector3d spacing_m_;
  Eigen::Vector3d inverse_spacing_per_m_;

 private:
  static constexpr std::size_t kBatch = 32;

  Eigen::Array3i last_segment_;  ///< last vertex along x and y, last segment along z
  SpreadConstants constants_;
  SpreadKernel<Segment> kernel_;
  Buffer<NeighbourSegment> neighbours_;
  std::uint32_t fills_ = 0;
  Storage storage_;
};

}  // namespace forcegrid
