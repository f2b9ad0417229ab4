#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "forcegrid/force_method.h"

namespace forcegrid {

/// A box of the workspace cut into equal cells; vertices stand at the cells' corners.
struct GridGeometry {
  Eigen::Vector3d min_W = Eigen::Vector3d::Zero();  ///< [m] lowest corner
  Eigen::Vector3d max_W = Eigen::Vector3d::Zero();  ///< [m] highest corner
  Eigen::Vector3i cells =
      Eigen::Vector3i::Zero();  ///< p_x, p_y, p_z; vertices are one more an axis

  /// @throws std::invalid_argument naming the field: not finite, max <= min, cells < 1, or more
  ///         than 2^27 vertices.
  void check() const;

  Eigen::Vector3d spacing_m() const noexcept {
    return (max_W - min_W).cwiseQuotient(cells.cast<double>());
  }
  std::size_t vertex_count() const noexcept;
  std::size_t cell_count() const noexcept;
};

/// How a sample's force spreads over the vertices around it ("candle light").
///
///   w(d) = 1 / (1 + (d/L)^2) - (d/L) / ((r/L) (1 + (r/L)^2))   for d <= r, else 0
///
/// It falls from 1 at d = 0 to 0 at d = r. The paper adds 1 to d^2 without saying in which unit d
/// is; L is that unit, and it decides the result: with L in metres the field is a moving average
/// over the whole sphere, with 1 mm (the default here) it follows the nearest samples.
/// Source: forcegrid paper, section 5, with the unit made explicit.
struct CandleLight {
  double influence_radius_m = 0.0;  ///< r
  double unit_m = 1e-3;             ///< L

  double weight(double distance_m) const noexcept;
};

/// Forces at the vertices of a regular grid: the paper's data structure.
/// Thread-safe: no. Real-time: only the constructor allocates; nothing locks or throws after it.
class ForceGrid {
 public:
  /// Allocates 16 bytes a vertex (force and weight in single precision).
  /// @throws std::invalid_argument for a geometry or radius that is not usable, or when r reaches
  ///         over more than 2^24 vertices.
  ForceGrid(const GridGeometry& geometry, const CandleLight& candle_light);

  const GridGeometry& geometry() const noexcept { return geometry_; }
  const CandleLight& candle_light() const noexcept { return candle_light_; }

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

  /// One sample on its way into the grid.
  struct Fill {
    Eigen::Vector3f force_W = Eigen::Vector3f::Zero();
    Eigen::Vector3f from_nearest_vertex_m = Eigen::Vector3f::Zero();
    Eigen::Vector3i nearest_vertex = Eigen::Vector3i::Zero();
    std::size_t next = 0;  ///< entry of the table of neighbours that comes next
    bool whole_sphere_inside = false;
  };

  /// Prepares to spread `force_W`, computed at `position_W`, over all vertices within r.
  /// @returns false, with `fill` untouched, for input that is not finite or outside the box.
  [[nodiscard]] bool begin_fill(const Eigen::Vector3d& position_W, const Eigen::Vector3d& force_W,
                                Fill& fill) const noexcept;

  /// Visits at most `budget` further vertices, rounded up to a multiple of 8, nearest first (to
  /// within half a cell's diagonal), and updates those within r:
  ///
  ///   F_v <- (w_v F_v + w(d) F) / (w_v + w(d)),   w_v <- w_v + w(d)
  ///
  /// Each vertex changes in one step, so any query in between is consistent.
  /// @returns the number of vertices visited; `finished(fill)` tells when it is done.
  int continue_fill(Fill& fill, int budget) noexcept;
  bool finished(const Fill& fill) const noexcept { return fill.next >= neighbour_count_; }

  /// Vertices that a fill visits when it is not cut at the border.
  int vertices_per_fill() const noexcept { return static_cast<int>(neighbour_count_); }

  /// Bytes allocated: vertices and the table of neighbours.
  std::size_t allocated_bytes() const noexcept;

  /// Sets vertices [first, last) to null force with weight 0.
  void clear(std::size_t first, std::size_t last) noexcept;

  /// Force [N] and weight of the vertex (i, j, k), which must exist. For tests and pictures.
  Eigen::Vector4f vertex(int i, int j, int k) const noexcept;

  /// The index of the cell that holds `position_W`, for counters a cell; `position_W` must be
  /// finite and inside.
  std::size_t cell_index(const Eigen::Vector3d& position_W) const noexcept;

 private:
  struct alignas(16) Vertex {
    float force_W[3];
    float weight;  ///< sum of the samples' weights, kNoData before the first
  };
  static constexpr float kNoData = -1e30F;
  static constexpr Vertex kEmpty{{0.0F, 0.0F, 0.0F}, kNoData};
  struct Neighbour {
    std::int16_t di, dj, dk, padding;
  };
  /// An aligned load of one SIMD register from plain numbers.
  template <typename Register>
  static Register load(const void* aligned) noexcept {
    Register value;
    __builtin_memcpy(&value, __builtin_assume_aligned(aligned, sizeof value), sizeof value);
    return value;
  }
  /// The four lanes' sign bits, lane 0 lowest.
  template <typename Register>
  static int sign_bits(Register value) noexcept {
#ifdef __SSE2__
    using Float4 = float __attribute__((vector_size(16)));
    return __builtin_ia32_movmskps(reinterpret_cast<Float4>(value));
#else
    using Int4 = std::int32_t __attribute__((vector_size(16)));
    const auto negative = reinterpret_cast<Int4>(value) < 0;
    return (negative[0] & 1) | (negative[1] & 2) | (negative[2] & 4) | (negative[3] & 8);
#endif
  }
  ForceEstimate sample_with_status(const Eigen::Vector3d& position_W) const noexcept;
  template <bool kChecked>
  void update_eight(const Fill& fill, std::size_t first) noexcept;
  std::size_t vertex_index(int i, int j, int k) const noexcept {
    return static_cast<std::size_t>(i * slab_ + j * row_ + k);
  }

  GridGeometry geometry_;
  CandleLight candle_light_;
  Eigen::Vector3d spacing_m_;
  Eigen::Vector3d inverse_spacing_per_m_;
  alignas(16) std::array<double, 4> min_{};      ///< the box's lowest corner
  alignas(16) std::array<double, 4> inverse_{};  ///< of the spacing
  alignas(16) std::array<float, 4> last_{};      ///< index of the last vertex an axis
  std::ptrdiff_t row_ = 0;                       ///< vertices from one to the next along y
  std::ptrdiff_t slab_ = 0;                      ///< and along x
  std::size_t row_bytes_ = 0, slab_bytes_ = 0;
  std::vector<Vertex> data_;  ///< z runs fastest

  // Neighbours of a vertex in order of distance, padded to a multiple of 8 with far-away ones.
  std::size_t neighbour_count_ = 0;
  std::vector<Neighbour> neighbours_;
  std::vector<std::ptrdiff_t> neighbour_offset_;
  std::vector<float> neighbour_x_m_, neighbour_y_m_, neighbour_z_m_;
  Eigen::Vector3i reach_vertices_;  ///< how far a fill reaches from its nearest vertex
};

// In the header since a call costs as much as the eight loads. Whatever is not plainly inside and
// known everywhere goes the slow way. The position becomes a cell and a fraction in single
// precision: 4e-6 of a cell on 50 cells an axis, below what the stored forces resolve.
inline ForceEstimate ForceGrid::sample(const Eigen::Vector3d& position_W) const noexcept {
  using Double2 = double __attribute__((vector_size(16)));
  using Double4 = double __attribute__((vector_size(32)));
  using Float4 = float __attribute__((vector_size(16)));
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
  // upper border itself, which are inside as well, go the slow way.
  const Int4 inside = (index < last) & ~reinterpret_cast<Int4>(index);
  if (sign_bits(inside) != 0b1111) [[unlikely]] {
    return sample_with_status(position_W);
  }
  const Int4 cell = __builtin_convertvector(index, Int4);
  const Float4 fraction = index - __builtin_convertvector(cell, Float4);

  // Unsigned, so that no sign has to be extended, and bytes, so that nothing has to be scaled.
  using Unsigned4 = std::uint32_t __attribute__((vector_size(16)));
  const auto at = reinterpret_cast<Unsigned4>(cell);
  const std::size_t row = row_bytes_;
  const std::size_t slab = slab_bytes_;
  const char* const corner = reinterpret_cast<const char*>(data_.data()) +
                             (at[0] * slab + at[1] * row + at[2] * sizeof(Vertex));
  const float a = fraction[0];
  const float b = fraction[1];
  const float c = fraction[2];
  const auto mix_along_z = [c](const char* vertex) {
    const Float4 low = load<Float4>(vertex);
    return low + c * (load<Float4>(vertex + sizeof(Vertex)) - low);
  };
  const Float4 v00 = mix_along_z(corner);
  const Float4 v01 = mix_along_z(corner + row);
  const Float4 v10 = mix_along_z(corner + slab);
  const Float4 v11 = mix_along_z(corner + slab + row);
  const Float4 v0 = v00 + b * (v01 - v00);
  const Float4 v1 = v10 + b * (v11 - v10);
  const Float4 v = v0 + a * (v1 - v0);
  // One vertex without data pulls the fourth lane far below zero.
  if ((sign_bits(v) & 0b1000) != 0) [[unlikely]] {
    return sample_with_status(position_W);
  }
  ForceEstimate estimate;
  estimate.force_W = Eigen::Vector3d(v[0], v[1], v[2]);
  estimate.status = EstimateStatus::kOk;
  return estimate;
}

}  // namespace forcegrid
