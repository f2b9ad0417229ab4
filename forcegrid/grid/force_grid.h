// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>

#include "forcegrid/core/interpolation.h"
#include "forcegrid/grid/grid_storage.h"
#include "forcegrid/grid/spreading_grid.h"

namespace forcegrid {

/// The kernel of grids of these segments.
template <typename Segment>
SpreadKernel<Segment> spread_kernel(Instructions instructions) noexcept {
  if constexpr (std::is_same_v<Segment, HalfSegment>) {
    static_cast<void>(instructions);
    return spread_half;
  } else {
    return spread_force_kernel(instructions);
  }
}

/// Forces at the vertices of a regular grid: the paper's data structure. A Segment is a
/// ForceSegment or, in half precision, a HalfSegment. Thread-safe: no. Real-time: only the
/// constructor allocates; nothing locks or throws after it.
template <typename Storage, typename Segment = ForceSegment>
class ForceGrid : public SpreadingGrid<Storage, Segment> {
  using Base = SpreadingGrid<Storage, Segment>;

 public:
  using Fill = typename Base::Fill;

  /// @param largest_reach vertices per axis beyond which a fill need not reach.
  ForceGrid(const GridGeometry& geometry, const RadialWeight& weighting, Storage&& storage,
            Interpolation interpolation = Interpolation::kTrilinear,
            Instructions instructions = Instructions::kBest,
            int largest_reach = std::numeric_limits<int>::max()) noexcept
      : Base(geometry, weighting, largest_reach, spread_kernel<Segment>(instructions),
             std::move(storage)),
        interpolation_(interpolation) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      min_[a] = geometry.min_W[axis];
      inverse_[a] = this->inverse_spacing_per_m_[axis];
      last_[a] = static_cast<float>(geometry.cells[axis]);
    }
    last_[3] = 1.0F;  // the fourth lane, always zero, counts as inside
  }

  /// The force at `position_W` in the interpolation chosen.
  [[nodiscard]] ForceEstimate read(const Eigen::Vector3d& position_W) const noexcept {
    return interpolation_ == Interpolation::kTrilinear ? sample(position_W)
                                                       : sample_tricubic(position_W);
  }

  /// Trilinear interpolation of the eight vertices of the cell that holds `position_W`:
  ///
  ///   F(u,v,w) = sum_{a,b,c in {0,1}} u_a v_b w_c F_abc,   u_0 = 1 - u, u_1 = u
  ///
  /// Exact for multilinear fields; continuous across cells, its gradient is not. The grid's upper
  /// borders belong to the last cells. Source: forcegrid paper, section 4 (the same polynomial,
  /// factored; its bound i < p_x - 1 would lose the last layer of cells).
  /// @returns kOutside beyond the box, kNotFinite for NaN or infinity. Of the vertices that
  ///          contribute at all: kUnknown when none has been reached by a sample, kPartlyKnown when
  ///          some have not (they count as null forces, as in the paper).
  /// Real-time: 8 aligned loads.
  [[nodiscard]] ForceEstimate sample(const Eigen::Vector3d& position_W) const noexcept;

  /// Cubic convolution over the 64 vertices around: along each axis, with t in the middle interval,
  ///
  ///   f(t) = f_0 + t/2 (f_1 - f_-1 + t (2 f_-1 - 5 f_0 + 4 f_1 - f_2
  ///          + t (3 (f_0 - f_1) + f_2 - f_-1)))
  ///
  /// Exact for quadratic fields, with a continuous gradient. Vertices beyond the border are
  /// extrapolated linearly, which keeps affine fields exact. If no sample has reached one of the
  /// 64, and wherever sample() isn't kOk, the answer is that of sample().
  /// Source: Keys, Cubic convolution interpolation for digital image processing, 1981 (a = -1/2).
  /// Real-time: 72 aligned loads.
  [[nodiscard]] ForceEstimate sample_tricubic(const Eigen::Vector3d& position_W) const noexcept;

  /// The vertex (i, j, k), which must exist.
  ForceVertex vertex(int i, int j, int k) const noexcept {
    return unpacked(this->storage()
                        .segment(i, j, k / kSegmentVertices)
                        .vertices[static_cast<std::size_t>(k % kSegmentVertices)]);
  }

  /// Force and weight at a position inside, both by trilinear interpolation; without data if one of
  /// the contributing vertices has none.
  ForceVertex blended_vertex(const Eigen::Vector3d& position_W) const noexcept;

 private:
  using Float4 = float __attribute__((vector_size(16)));

  /// An aligned load of one SIMD register from plain numbers.
  template <typename Register>
  static Register load(const void* aligned) noexcept {
    Register value;
    __builtin_memcpy(&value, __builtin_assume_aligned(aligned, sizeof value), sizeof value);
    return value;
  }
  /// Force and weight of a vertex.
  static Float4 lanes_of(const ForceVertex* vertex) noexcept { return load<Float4>(vertex); }
  static Float4 lanes_of(const HalfVertex* vertex) noexcept {
    const ForceVertex v = unpacked(*vertex);
    return Float4{v.force_W_N[0], v.force_W_N[1], v.force_W_N[2], v.weight};
  }
  /// The four lanes' sign bits, lane 0 lowest.
  template <typename Register>
  static int sign_bits(Register value) noexcept {
#ifdef __SSE2__
    return __builtin_ia32_movmskps(reinterpret_cast<Float4>(value));
#else
    using Int4 = std::int32_t __attribute__((vector_size(16)));
    const auto negative = reinterpret_cast<Int4>(value) < 0;
    return (negative[0] & 1) | (negative[1] & 2) | (negative[2] & 4) | (negative[3] & 8);
#endif
  }
  ForceEstimate sample_with_status(const Eigen::Vector3d& position_W) const noexcept;

  Interpolation interpolation_;
  alignas(16) std::array<double, 4> min_{};      ///< the box's lowest corner
  alignas(16) std::array<double, 4> inverse_{};  ///< of the spacing
  alignas(16) std::array<float, 4> last_{};      ///< index of the last vertex per axis
};

// In the header, since a call costs as much as the eight loads. Positions that are not plainly
// inside and known everywhere take the slow path. The position becomes a cell and a fraction in
// single precision: 4e-6 of a cell on 50 cells per axis, below the resolution of the stored forces.
template <typename Storage, typename Segment>
inline ForceEstimate ForceGrid<Storage, Segment>::sample(
    const Eigen::Vector3d& position_W) const noexcept {
  using Double2 = double __attribute__((vector_size(16)));
  using Double4 = double __attribute__((vector_size(32)));
  using Int4 = std::int32_t __attribute__((vector_size(16)));
  Double2 xy;
  __builtin_memcpy(&xy, position_W.data(), sizeof xy);
  xy = (xy - load<Double2>(min_.data())) * load<Double2>(inverse_.data());
  Double2 z = {position_W.z(), 0.0};
  z = (z - load<Double2>(min_.data() + 2)) * load<Double2>(inverse_.data() + 2);
  const Double4 exact_index = {xy[0], xy[1], z[0], z[1]};
  const Float4 index = __builtin_convertvector(exact_index, Float4);
  const Float4 last = load<Float4>(last_.data());
  // Below the last vertex (false for NaN) and no sign bit set: inside. A negative zero and the
  // upper border itself are inside as well, but take the slow path.
  const Int4 inside = (index < last) & ~reinterpret_cast<Int4>(index);
  if (sign_bits(inside) != 0b1111) [[unlikely]] {
    return sample_with_status(position_W);
  }
  const Int4 cell = __builtin_convertvector(index, Int4);
  const Float4 fraction = index - __builtin_convertvector(cell, Float4);

  // Unsigned, so that no sign has to be extended.
  using Unsigned4 = std::uint32_t __attribute__((vector_size(16)));
  const auto at = reinterpret_cast<Unsigned4>(cell);
  const float a = fraction[0];
  const float b = fraction[1];
  const float c = fraction[2];
  const Float4 v =
      this->storage().with_corners(at[0], at[1], at[2], [a, b, c](const auto& corners) {
        const auto mix_along_z = [c](const auto* below, const auto* above) {
          const Float4 low = lanes_of(below);
          return low + c * (lanes_of(above) - low);
        };
        const Float4 v00 =
            mix_along_z(corners.template at<0, 0, 0>(), corners.template at<0, 0, 1>());
        const Float4 v01 =
            mix_along_z(corners.template at<0, 1, 0>(), corners.template at<0, 1, 1>());
        const Float4 v10 =
            mix_along_z(corners.template at<1, 0, 0>(), corners.template at<1, 0, 1>());
        const Float4 v11 =
            mix_along_z(corners.template at<1, 1, 0>(), corners.template at<1, 1, 1>());
        const Float4 v0 = v00 + b * (v01 - v00);
        const Float4 v1 = v10 + b * (v11 - v10);
        return v0 + a * (v1 - v0);
      });
  // One vertex without data pulls the fourth lane far below zero.
  if ((sign_bits(v) & 0b1000) != 0) [[unlikely]] {
    return sample_with_status(position_W);
  }
  ForceEstimate estimate;
  estimate.force_W = Eigen::Vector3d(v[0], v[1], v[2]);
  estimate.status = EstimateStatus::kOk;
  return estimate;
}

template <typename Storage, typename Segment>
ForceEstimate ForceGrid<Storage, Segment>::sample_with_status(
    const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  if (!position_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return estimate;
  }
  if (!this->inside(position_W)) {
    estimate.status = EstimateStatus::kOutside;
    return estimate;
  }
  const Eigen::Vector3i cell = this->cell(position_W);
  const Eigen::Array3d t = this->index_position(position_W) - cell.cast<double>().array();
  int known = 0;
  int unknown = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Array3i step(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    const double share = (step > 0).select(t, 1.0 - t).prod();
    if (share == 0.0) {
      continue;
    }
    const Eigen::Array3i at = cell.array() + step;
    const ForceVertex v = vertex(at.x(), at.y(), at.z());
    if (v.weight < 0.0F) {
      ++unknown;
      continue;
    }
    ++known;
    estimate.force_W += share * Eigen::Vector3d(v.force_W_N[0], v.force_W_N[1], v.force_W_N[2]);
  }
  if (known > 0) {
    estimate.status = unknown == 0 ? EstimateStatus::kOk : EstimateStatus::kPartlyKnown;
  }
  return estimate;
}

template <typename Storage, typename Segment>
ForceVertex ForceGrid<Storage, Segment>::blended_vertex(
    const Eigen::Vector3d& position_W) const noexcept {
  const Eigen::Vector3i cell = this->cell(position_W);
  const Eigen::Array3f t =
      (this->index_position(position_W) - cell.cast<double>().array()).template cast<float>();
  ForceVertex blend{.force_W_N = {}, .weight = 0.0F};
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Array3i step(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
    const float share = (step > 0).select(t, 1.0F - t).prod();
    if (share == 0.0F) {
      continue;
    }
    const Eigen::Array3i at = cell.array() + step;
    const ForceVertex v = vertex(at.x(), at.y(), at.z());
    if (v.weight < 0.0F) {
      return ForceVertex{};
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      blend.force_W_N[axis] += share * v.force_W_N[axis];
    }
    blend.weight += share * v.weight;
  }
  return blend;
}

template <typename Storage, typename Segment>
ForceEstimate ForceGrid<Storage, Segment>::sample_tricubic(
    const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate = sample(position_W);
  if (estimate.status != EstimateStatus::kOk) {
    return estimate;
  }
  const Eigen::Vector3i cell = this->cell(position_W);
  const Eigen::Array3f t =
      (this->index_position(position_W) - cell.cast<double>().array()).template cast<float>();
  std::array<std::array<float, 4>, 3> share;
  std::array<int, 3> first{};
  std::array<int, 3> end{};
  for (int axis = 0; axis < 3; ++axis) {
    const float u = t[axis];
    const float u2 = u * u;
    const float u3 = u2 * u;
    auto& w = share[static_cast<std::size_t>(axis)];
    w = {0.5F * (-u + 2.0F * u2 - u3), 1.0F + 0.5F * (-5.0F * u2 + 3.0F * u3),
         0.5F * (u + 4.0F * u2 - 3.0F * u3), 0.5F * (u3 - u2)};
    const bool below = cell[axis] > 0;
    const bool above = cell[axis] + 2 <= this->geometry().cells[axis];
    if (!below) {  // f_-1 = 2 f_0 - f_1
      w[1] += 2.0F * w[0];
      w[2] -= w[0];
    }
    if (!above) {  // f_2 = 2 f_1 - f_0
      w[2] += 2.0F * w[3];
      w[1] -= w[3];
    }
    first[static_cast<std::size_t>(axis)] = below ? 0 : 1;
    end[static_cast<std::size_t>(axis)] = above ? 4 : 3;
  }
  Float4 sum{};
  Float4 least{};
  for (int a = first[0]; a < end[0]; ++a) {
    Float4 plane{};
    for (int b = first[1]; b < end[1]; ++b) {
      Float4 line{};
      for (int c = first[2]; c < end[2]; ++c) {
        const int k = cell.z() - 1 + c;
        const auto& segment =
            this->storage().segment(cell.x() - 1 + a, cell.y() - 1 + b, k / kSegmentVertices);
        const Float4 v =
            lanes_of(&segment.vertices[static_cast<std::size_t>(k % kSegmentVertices)]);
        least = v < least ? v : least;
        line += share[2][static_cast<std::size_t>(c)] * v;
      }
      plane += share[1][static_cast<std::size_t>(b)] * line;
    }
    sum += share[0][static_cast<std::size_t>(a)] * plane;
  }
  if (least[3] == 0.0F) {  // else the fourth lane of one of them marks it as without data
    estimate.force_W = Eigen::Vector3d(sum[0], sum[1], sum[2]);
  }
  return estimate;
}

}  // namespace forcegrid
