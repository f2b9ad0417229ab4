// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/kriging/kriging_kernel.h"

/// The inner loops of kriging twice: through Highway, for the best instructions that the processor
/// has (chosen at run time), and as plain loops that tests compare them with.
/// Real-time: bounded, no allocation, lock or throw. Threads: any.
namespace forcegrid::kriging {

/// Numbers that a lane-wise loop may read or write behind the last valid one.
inline constexpr int kLanePadding = 16;

constexpr int padded(int count, int multiple) {
  return (count + multiple - 1) / multiple * multiple;
}

/// What the radial part of a field is read from: rows of `stride` numbers, padded to whole
/// multiples of kLanePadding (stiffness: 4) with weights of zero at positions far away, aligned to
/// 64 bytes.
template <typename Real>
struct RadialTerms {
  /// x, y, z of the samples in units of the kernel's length, then alpha_x, alpha_y, alpha_z.
  const Real* sample_rows = nullptr;
  int stride = 0;
  int samples = 0;  ///< padded
  const Real* stiffness_rows =
      nullptr;  ///< x, y, z [m], then the six of M, halved off the diagonal
  int stiffness_stride = 0;
  int stiffness_samples = 0;  ///< padded
  RadialShape shape = RadialShape::kSquaredExponential;
  Real length_m = Real(0.03);
  Real inverse_length_per_m = Real(1) / Real(0.03);

  const Real* position(int axis) const noexcept { return sample_rows + axis * stride; }
  const Real* weight(int axis) const noexcept { return sample_rows + (3 + axis) * stride; }
  const Real* stiffness_position_m(int axis) const noexcept {
    return stiffness_rows + axis * stiffness_stride;
  }
  const Real* stiffness_weight(int component) const noexcept {
    return stiffness_rows + (3 + component) * stiffness_stride;
  }
};

template <typename Real>
struct RadialSum {
  Real force_N[3];
  Real nearest_m2;  ///< squared distance of the nearest sample
};

/// The radial part of the force at p (relative to the contact point, like all positions here), less
/// sum_i alpha_i:
///
///   sum_i  (-g' - 1) alpha_i - g'' d (d.alpha_i)  +  sum_m  g'' (2 M d + tr(M) d) + g''' d (d.M d)
///
/// with d = p - p_i; the derivatives g are Kernel's, and -g' is 1 where d is zero. Samples near
/// each other have large weights of opposite signs. What is left out does not depend on p and is
/// summed in double precision; in single precision it would hide what differs from place to place.
RadialSum<float> radial_sum(const RadialTerms<float>& terms, const float p_m[3]) noexcept;
RadialSum<double> radial_sum(const RadialTerms<double>& terms, const double p_m[3]) noexcept;
template <typename Real>
RadialSum<Real> radial_sum_scalar(const RadialTerms<Real>& terms, const Real p_m[3]) noexcept;

/// A symmetric stiffness [N/m] in the order of kStiffnessRow.
template <typename Real>
struct RadialSlope {
  Real stiffness_N_per_m[6];
};

/// The derivative dF/dp of the samples' part of radial_sum():
///
///   sum_i  -g'' (alpha_i d^T + d alpha_i^T + (d.alpha_i) I) - g''' (d.alpha_i) d d^T
RadialSlope<float> radial_slope(const RadialTerms<float>& terms, const float p_m[3]) noexcept;
RadialSlope<double> radial_slope(const RadialTerms<double>& terms, const double p_m[3]) noexcept;
template <typename Real>
RadialSlope<Real> radial_slope_scalar(const RadialTerms<Real>& terms, const Real p_m[3]) noexcept;

/// Lower triangular matrix, packed column by column; columns begin at their diagonal. Behind the
/// last column kLanePadding finite numbers may be read.
struct PackedLower {
  double* data = nullptr;
  const double* inverse_diagonal = nullptr;
  int capacity = 0;  ///< rows that it has room for
  int rows = 0;

  /// Row r >= j of column j is column(j)[r].
  double* column(int j) const noexcept { return data + j * capacity - j * (j + 1) / 2; }
};

/// x_c <- L^-1 x_c for three right-hand sides. Each has room for kLanePadding numbers behind its
/// rows, which are overwritten.
void solve_lower(const PackedLower& l, double* const x[3]) noexcept;
void solve_lower_scalar(const PackedLower& l, double* const x[3]) noexcept;

/// x <- L^-T x, with the same room.
void solve_upper(const PackedLower& l, double* x) noexcept;
void solve_upper_scalar(const PackedLower& l, double* x) noexcept;

/// Three Givens rotations, one after the other.
struct Rotations {
  double c[3];
  double s[3];
};

/// Rotates a column of `count` numbers with each of three others in turn:
///   column <- c_i column + s_i other_i,   other_i <- c_i other_i - s_i column (as it was),
/// and writes the column to `moved`, which may lie below it in the same array, as far as three of
/// PackedLower's columns do. Behind each of them kLanePadding finite numbers may be read, and those
/// behind `moved` and the others are overwritten.
void rotate(const double* column, double* const others[3], double* moved, int count,
            const Rotations& by) noexcept;
void rotate_scalar(const double* column, double* const others[3], double* moved, int count,
                   const Rotations& by) noexcept;

/// Name of the instruction set in use, e.g. "AVX2".
const char* instruction_set() noexcept;

}  // namespace forcegrid::kriging
