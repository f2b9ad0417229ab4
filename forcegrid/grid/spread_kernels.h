// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "forcegrid/core/radial_weight.h"
#include "forcegrid/grid/grid_segments.h"

namespace forcegrid {

/// A sample in the kernels' form: single precision, with everything precomputed that is the same
/// for all vertices.
struct SpreadSample {
  std::array<float, 3> force_W_N{};
  std::array<float, 9> stiffness_W_N_per_m{};  ///< dF/dP row by row, of samples that have it
  bool has_stiffness = false;
};

/// The parameters of a grid's weight and spacing that its kernels need.
struct SpreadConstants {
  WeightKind kind = WeightKind::kPaper;
  float radius2_m2 = 0.0F;            ///< r^2
  float inverse_radius_per_m = 0.0F;  ///< 1/r
  /// 1/L of the paper's weight; 1/h of idw4, 2/h of idw6
  float inverse_scale_per_m = 0.0F;
  float slope = 0.0F;  ///< of the paper's weight, 1 / ((r/L) (1 + (r/L)^2))
  float spacing_z_m = 0.0F;
};

SpreadConstants spread_constants(const RadialWeight& weighting, double spacing_z_m) noexcept;

/// A segment to update, and where its first vertex is relative to the sample.
template <typename Segment>
struct SegmentWork {
  Segment* segment = nullptr;
  float x_m = 0.0F, y_m = 0.0F, z_m = 0.0F;
};

/// Spreads a sample over the vertices of `count` segments that lie within r of it:
///
///   F_v <- (w_v F_v + w(d) (F + J (v - P))) / (w_v + w(d)),   w_v <- w_v + w(d)
///
/// with J = 0 for a sample without stiffness; each vertex changes in one step.
/// Real-time: no allocation, lock or throw.
template <typename Segment>
using SpreadKernel = void (*)(const SpreadConstants& constants, const SpreadSample& sample,
                              const SegmentWork<Segment>* work, std::size_t count) noexcept;

enum class Instructions {
  kBest,    ///< the widest SIMD instructions that this processor has, chosen at run time
  kScalar,  ///< plain C++, one vertex after the other
};

/// The formula above.
SpreadKernel<ForceSegment> spread_force_kernel(Instructions instructions) noexcept;
/// The same on vertices in half precision, in plain C++: each is rounded when it has changed.
void spread_half(const SpreadConstants& constants, const SpreadSample& sample,
                 const SegmentWork<HalfSegment>* work, std::size_t count) noexcept;

/// Adds the sample's w(d) times 1, u, u u^T, F and F u^T to the vertices' moments.
SpreadKernel<MomentSegment> spread_moments_kernel(Instructions instructions) noexcept;

/// The moments of a cell's eight corners, gathered for fit_corners(); [moment][corner].
struct alignas(64) CornerMoments {
  std::array<std::array<float, 8>, kMoments> moments;
};

/// The forces that fits of the corners' moments give at the corners; [axis][corner].
struct alignas(64) CornerForces {
  std::array<std::array<double, 8>, 3> force_W_N;
};

/// Weighted affine least squares at each corner, the value extrapolated to the corner itself:
///
///   m = S_u / S, G = (S_Fu / S - (S_F / S) m^T) (S_uu / S - m m^T + ridge I)^-1,
///   F_v = S_F / S - G m
///
/// Corners without samples get null. In double precision.
using FitCorners = void (*)(const CornerMoments& moments, double ridge,
                            CornerForces& forces) noexcept;
FitCorners fit_corners_kernel(Instructions instructions) noexcept;

/// The instruction set that Instructions::kBest stands for here, e.g. "AVX2".
const char* best_instructions() noexcept;

}  // namespace forcegrid
