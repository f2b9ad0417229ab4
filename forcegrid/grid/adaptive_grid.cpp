// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/adaptive_grid.h"

namespace forcegrid {
namespace {

// The inverse powers' h is the spacing of the grid that they fill.
RadialWeight for_grid(const RadialWeight& weighting, const GridGeometry& geometry) noexcept {
  RadialWeight result = weighting;
  result.mean_spacing_m = std::cbrt(geometry.spacing_m().prod());
  return result;
}

// If h is smaller by a factor c, (d/h)^p grows by c^p.
double inherited_share(WeightKind kind, double spacing_ratio) noexcept {
  switch (kind) {
    case WeightKind::kPaper:
      return 1.0;
    case WeightKind::kInverse4:
      return std::pow(spacing_ratio, 4);
    case WeightKind::kInverse6:
      return std::pow(spacing_ratio, 6);
  }
  return 1.0;
}

// A sample may lie where the tool was a few samples ago, so a fill reaches beyond the cube.
constexpr int kLargestReach = 24;

}  // namespace

WindowStorage::WindowStorage(const Eigen::Vector3i& vertices) noexcept
    : blocks_((vertices.array() + kBlockVertices - 1) / kBlockVertices),
      segments_((kPlaces + 1) * kBlockSegments, ForceSegment{}) {
  restart();
}

void WindowStorage::restart() noexcept { keys_.fill(kNone); }

void WindowStorage::centre_at(const Eigen::Vector3i& vertex) noexcept {
  first_ = (vertex.array() + kBlockVertices / 2) / kBlockVertices - kBlocks / 2;
}

bool WindowStorage::wanted(const Eigen::Vector3i& block) const noexcept {
  return (block.array() >= first_.array().max(0)).all() &&
         (block.array() < (first_.array() + kBlocks).min(blocks_.array())).all();
}

bool WindowStorage::next_missing(Eigen::Vector3i& block) const noexcept {
  int nearest = kBlocks * kBlocks * kBlocks;
  for (int x = 0; x < kBlocks; ++x) {
    for (int y = 0; y < kBlocks; ++y) {
      for (int z = 0; z < kBlocks; ++z) {
        const Eigen::Array3i offset(x, y, z);
        const Eigen::Vector3i candidate = first_.array() + offset;
        // Twice the distance of the block's middle from the cube's, along the axes together.
        const int distance = (2 * offset + 1 - kBlocks).abs().sum();
        if (distance >= nearest || !wanted(candidate)) {
          continue;
        }
        const auto at = candidate.cast<std::uint32_t>();
        if (keys_[place(at.x(), at.y(), at.z())] != key(at.x(), at.y(), at.z())) {
          nearest = distance;
          block = candidate;
        }
      }
    }
  }
  return nearest < kBlocks * kBlocks * kBlocks;
}

ForceSegment* WindowStorage::begin_block(const Eigen::Vector3i& block) noexcept {
  const auto at = block.cast<std::uint32_t>();
  const std::size_t to = place(at.x(), at.y(), at.z());
  keys_[to] = kNone;
  return segments_.data() + to * kBlockSegments;
}

void WindowStorage::complete(const Eigen::Vector3i& block) noexcept {
  const auto at = block.cast<std::uint32_t>();
  keys_[place(at.x(), at.y(), at.z())] = key(at.x(), at.y(), at.z());
}

GridGeometry AdaptiveGrid::sparse_geometry(const GridGeometry& geometry) noexcept {
  GridGeometry sparse = geometry;
  sparse.cells = (geometry.cells.array() + kCoarsening - 1) / kCoarsening;
  return sparse;
}

AdaptiveGrid::AdaptiveGrid(const GridGeometry& geometry, const RadialWeight& weighting,
                           bool counting, Interpolation interpolation,
                           Instructions instructions) noexcept
    : sparse_(sparse_geometry(geometry), for_grid(weighting, sparse_geometry(geometry)),
              DenseStorage<ForceSegment>(sparse_geometry(geometry).cells.array() + 1, counting),
              interpolation, instructions),
      dense_(geometry, for_grid(weighting, geometry), WindowStorage(geometry.cells.array() + 1),
             interpolation, instructions, kLargestReach),
      inherited_share_(static_cast<float>(inherited_share(
          weighting.kind,
          std::cbrt((geometry.spacing_m().array() / sparse_geometry(geometry).spacing_m().array())
                        .prod())))) {}

int AdaptiveGrid::continue_fill(Fill& fill, int budget) noexcept {
  int done = 0;
  if (!sparse_.finished(fill.sparse)) {
    done += sparse_.continue_fill(fill.sparse, budget);
  }
  if (done < budget) {
    done += dense_.continue_fill(fill.dense, budget - done);
  }
  return done;
}

ForceEstimate AdaptiveGrid::read(const Eigen::Vector3d& position_W) const noexcept {
  const ForceEstimate near = dense_.read(position_W);
  return near.status == EstimateStatus::kOk ? near : sparse_.read(position_W);
}

void AdaptiveGrid::restart() noexcept {
  sparse_.restart();
  dense_.restart();
  next_segment_ = 0;
}

void AdaptiveGrid::follow(const Eigen::Vector3d& position_W) noexcept {
  if (dense_.inside(position_W)) {
    dense_.storage().centre_at(dense_.cell(position_W));
  }
}

int AdaptiveGrid::prepare(int budget) noexcept {
  WindowStorage& cube = dense_.storage();
  int done = 0;
  while (done < budget) {
    if (next_segment_ > 0 && !cube.wanted(block_)) {
      next_segment_ = 0;  // the tool has moved since
    }
    if (next_segment_ == 0 && !cube.next_missing(block_)) {
      break;
    }
    ForceSegment& segment = cube.begin_block(block_)[next_segment_];
    const Eigen::Vector3i first(block_.x() * kBlockVertices + next_segment_ / kBlockVertices,
                                block_.y() * kBlockVertices + next_segment_ % kBlockVertices,
                                block_.z() * kBlockVertices);
    for (int lane = 0; lane < kSegmentVertices; ++lane) {
      // Vertices of the block beyond the grid's border are never read; they repeat the border's.
      const Eigen::Vector3d index =
          (first + Eigen::Vector3i(0, 0, lane)).cwiseMin(dense_.geometry().cells).cast<double>();
      const GridGeometry& g = dense_.geometry();
      const Eigen::Vector3d at_W = (g.min_W + index.cwiseProduct(g.spacing_m())).cwiseMin(g.max_W);
      ForceVertex vertex = sparse_.blended_vertex(at_W);
      if (vertex.weight > 0.0F) {
        vertex.weight *= inherited_share_;
      }
      segment.vertices[static_cast<std::size_t>(lane)] = vertex;
    }
    done += kSegmentVertices;
    if (++next_segment_ == kBlockSegments) {
      cube.complete(block_);
      next_segment_ = 0;
    }
  }
  return done;
}

}  // namespace forcegrid
