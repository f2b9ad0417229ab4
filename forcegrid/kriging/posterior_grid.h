// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/core/storage_blocks.h"
#include "forcegrid/grid/grid_storage.h"

namespace forcegrid {

/// The content of a vertex for a conservative force field: 12 floats.
struct alignas(16) PosteriorVertex {
  std::array<float, 3> force_N{};
  float known = kUnknown;  ///< 1, or far below zero so that a blend shows that one is missing
  std::array<float, 3> normal_N_per_m{};  ///< dF/dP: xx, yy, zz
  float nearest_m = 0.0F;                 ///< distance of the nearest sample when it was written
  std::array<float, 3> shear_N_per_m{};   ///< yz, xz, xy
  float written = 0.0F;                   ///< number of the fit that it was written after

  static constexpr float kUnknown = -1e30F;
};
static_assert(sizeof(PosteriorVertex) == 48);

struct alignas(64) PosteriorSegment {
  using Vertex = PosteriorVertex;
  std::array<PosteriorVertex, kSegmentVertices> vertices{};
};

/// A force field at the vertices of a sparse grid, force and stiffness, read with half of the
/// gradient:
///
///   F(P) = sum_v w_v [F_v + 1/2 J_v (P - v)]
///
/// over the eight vertices v around P with the trilinear weights w. Exact for quadratic fields (the
/// whole gradient would have the same error as none, with the opposite sign), continuous across
/// cells; the error is proportional to the third derivative and h^3.
/// Source: the method study, docs/kriging.md.
/// Memory: blocks of 8 x 8 x 8 vertices from a fixed pool, 24 KiB each; if the pool is used up, the
/// block that was written longest ago is dropped.
/// Real-time: only the constructor allocates; nothing locks or throws. Threads: one.
class PosteriorGrid {
 public:
  struct Value {
    Eigen::Vector3d force_N;
    /// dF/dP, assumed symmetric.
    Eigen::Matrix3d stiffness_N_per_m;
    double nearest_m;  ///< distance of the nearest sample
  };
  struct Reading {
    Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
    bool known = false;  ///< all eight vertices hold something; else the force is zero
  };

  /// @param min_m lowest corner of the box, `cells` its cells per axis, at least one, each
  ///        `spacing_m` wide.
  PosteriorGrid(const Eigen::Vector3d& min_m, const Eigen::Vector3i& cells, double spacing_m,
                std::size_t pool_blocks) noexcept;

  bool allocated() const noexcept { return storage_.allocated(); }
  std::size_t bytes() const noexcept { return storage_.bytes(); }
  static double bytes_for(const Eigen::Vector3i& cells, std::size_t pool_blocks) noexcept {
    return BlockStorage<PosteriorSegment>::bytes_for(cells.array() + 1, false, pool_blocks);
  }
  double spacing_m() const noexcept { return spacing_m_; }
  std::size_t blocks_in_use() const noexcept { return storage_.blocks_in_use(); }
  /// See StorageBlocks. @param origin_W  [m] what the grid's positions are relative to.
  std::size_t storage_blocks(const Eigen::Vector3d& origin_W,
                             std::span<StorageBlock> blocks) const noexcept {
    return boxes_of_blocks(storage_, origin_W + min_m_, Eigen::Vector3d::Constant(spacing_m_),
                           cells_, blocks);
  }
  /// Blocks that were dropped.
  std::uint64_t recycled() const noexcept { return storage_.recycled(); }

  bool inside(const Eigen::Vector3d& position_m) const noexcept {
    const Eigen::Array3d index = (position_m - min_m_).array() / spacing_m_;
    return (index >= 0.0).all() && (index <= cells_.cast<double>().array()).all();
  }
  bool has(const Eigen::Vector3i& vertex) const noexcept {
    return (vertex.array() >= 0).all() && (vertex.array() <= cells_.array()).all();
  }
  Eigen::Vector3i nearest_vertex(const Eigen::Vector3d& position_m) const noexcept {
    return ((position_m - min_m_).array() / spacing_m_).round().cast<int>();
  }
  Eigen::Vector3d position_m(const Eigen::Vector3i& vertex) const noexcept {
    return min_m_ + spacing_m_ * vertex.cast<double>();
  }

  /// The vertex, which must exist.
  const PosteriorVertex& vertex(const Eigen::Vector3i& at) const noexcept {
    return storage_.segment(at.x(), at.y(), at.z() / kSegmentVertices)
        .vertices[static_cast<std::size_t>(at.z() % kSegmentVertices)];
  }
  /// Writes it; `fit` is the number of the fit. Marks its block as used last.
  void write(const Eigen::Vector3i& at, const Value& value, std::uint32_t fit) noexcept;

  /// Not known beyond the box, for NaN, and where a vertex is unknown.
  [[nodiscard]] Reading read(const Eigen::Vector3d& position_m) const noexcept;

 private:
  using Float4 = float __attribute__((vector_size(16)));
  using Int4 = std::int32_t __attribute__((vector_size(16)));

  static Float4 load(const void* aligned) noexcept {
    Float4 value;
    __builtin_memcpy(&value, __builtin_assume_aligned(aligned, sizeof value), sizeof value);
    return value;
  }
  // F_v + 1/2 J_v d for half of d; with d rotated by one and by two places. The fourth lane: known.
  static Float4 extrapolated(const PosteriorVertex* v, Float4 half_d) noexcept {
    const Float4 shear = load(v->shear_N_per_m.data());
    return load(v->force_N.data()) + load(v->normal_N_per_m.data()) * half_d +
           __builtin_shufflevector(shear, shear, 2, 0, 1, 3) *
               __builtin_shufflevector(half_d, half_d, 1, 2, 0, 3) +
           __builtin_shufflevector(shear, shear, 1, 2, 0, 3) *
               __builtin_shufflevector(half_d, half_d, 2, 0, 1, 3);
  }

  Eigen::Vector3d min_m_;
  Eigen::Vector3i cells_;
  double spacing_m_;
  double inverse_per_m_;
  Eigen::Vector3d last_;  ///< index of the last vertex per axis
  float half_spacing_m_;
  BlockStorage<PosteriorSegment> storage_;
};

inline PosteriorGrid::Reading PosteriorGrid::read(
    const Eigen::Vector3d& position_m) const noexcept {
  Reading reading;
  const double x = (position_m.x() - min_m_.x()) * inverse_per_m_;
  const double y = (position_m.y() - min_m_.y()) * inverse_per_m_;
  const double z = (position_m.z() - min_m_.z()) * inverse_per_m_;
  // False for NaN; the upper border belongs to nothing.
  if (!(x >= 0.0 && y >= 0.0 && z >= 0.0 && x < last_.x() && y < last_.y() && z < last_.z())) {
    return reading;
  }
  const auto i = static_cast<std::uint32_t>(x);
  const auto j = static_cast<std::uint32_t>(y);
  const auto k = static_cast<std::uint32_t>(z);
  const auto a = static_cast<float>(x - i);
  const auto b = static_cast<float>(y - j);
  const auto c = static_cast<float>(z - k);
  const Float4 low = Float4{a, b, c, 0.0F} * half_spacing_m_;  // 1/2 (P - v) of the lowest corner
  const Float4 h = {half_spacing_m_, half_spacing_m_, half_spacing_m_, 0.0F};
  const Float4 v = storage_.with_corners(i, j, k, [&](const auto& corners) {
    constexpr Int4 kX = {-1, 0, 0, 0};
    constexpr Int4 kY = {0, -1, 0, 0};
    constexpr Int4 kZ = {0, 0, -1, 0};
    const auto masked = [&h](Int4 mask) {
      return reinterpret_cast<Float4>(reinterpret_cast<Int4>(h) & mask);
    };
    const Float4 step_x = masked(kX);
    const Float4 step_y = masked(kY);
    const Float4 step_z = masked(kZ);
    const auto along_z = [&](const PosteriorVertex* below, const PosteriorVertex* above,
                             Float4 half_d) {
      const Float4 first = extrapolated(below, half_d);
      return first + c * (extrapolated(above, half_d - step_z) - first);
    };
    const Float4 v00 = along_z(corners.template at<0, 0, 0>(), corners.template at<0, 0, 1>(), low);
    const Float4 v01 =
        along_z(corners.template at<0, 1, 0>(), corners.template at<0, 1, 1>(), low - step_y);
    const Float4 v10 =
        along_z(corners.template at<1, 0, 0>(), corners.template at<1, 0, 1>(), low - step_x);
    const Float4 v11 = along_z(corners.template at<1, 1, 0>(), corners.template at<1, 1, 1>(),
                               low - step_x - step_y);
    const Float4 v0 = v00 + b * (v01 - v00);
    const Float4 v1 = v10 + b * (v11 - v10);
    return v0 + a * (v1 - v0);
  });
  reading.known = v[3] > 0.0F;
  if (reading.known) {
    reading.force_N = Eigen::Vector3d(v[0], v[1], v[2]);
  }
  return reading;
}

}  // namespace forcegrid
