// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace forcegrid::pair {

/// Samples are read in groups of this many; the rest of the last group has weights of zero.
inline constexpr int kPairLanes = 16;
/// Samples whose stiffness is data, at most.
inline constexpr int kPairFewLanes = 8;

/// What the radial part of a PairField is read from: 12 rows of `stride` numbers, aligned to 64
/// bytes: the six coordinates of the samples in units of the kernel's length, then their weights.
struct PairTerms {
  const float* rows = nullptr;
  int stride = 0;   ///< a multiple of kPairLanes
  int samples = 0;  ///< padded to a multiple of kPairLanes
  /// 27 rows of kPairFewLanes numbers: the coordinates of the samples with a stiffness, in the same
  /// units, then the upper triangle of the symmetric M_m, row after row. Those beyond `few` are
  /// zero and far away.
  const float* few_rows = nullptr;
  int few = 0;

  const float* position(int axis) const noexcept { return rows + axis * stride; }
  const float* weight(int axis) const noexcept { return rows + (6 + axis) * stride; }
  const float* few_position(int axis) const noexcept { return few_rows + axis * kPairFewLanes; }
  const float* few_weight(int number) const noexcept {
    return few_rows + (6 + number) * kPairFewLanes;
  }
};

struct PairSum {
  float force_N[6];
  float nearest2;  ///< squared distance of the nearest sample, in units of the kernel's length
};

/// The radial part of the forces at p, in units of the kernel's length:
///
///   sum_i exp(-|d|^2 / 2) (alpha_i - d (d.alpha_i))
///   + sum_m exp(-|d|^2 / 2) (2 M_m d + (tr M_m - d.M_m d) d),   d = p - p_i or p - p_m
///
/// The first through Highway, for the best instructions that the processor has, the second as plain
/// loops that tests compare it with.
/// Real-time: bounded, no allocation, lock or throw. Threads: any.
PairSum pair_sum(const PairTerms& terms, const float p[6]) noexcept;
PairSum pair_sum_scalar(const PairTerms& terms, const float p[6]) noexcept;

}  // namespace forcegrid::pair
