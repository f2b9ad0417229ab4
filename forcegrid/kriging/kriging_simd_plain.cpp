// SPDX-License-Identifier: Apache-2.0
// In place of kriging_simd.cpp where there is neither Highway nor a vector unit.
#include "forcegrid/kriging/kriging_simd.h"

namespace forcegrid::kriging {

RadialSum<float> radial_sum(const RadialTerms<float>& terms, const float p_m[3]) noexcept {
  return radial_sum_scalar(terms, p_m);
}
RadialSum<double> radial_sum(const RadialTerms<double>& terms, const double p_m[3]) noexcept {
  return radial_sum_scalar(terms, p_m);
}
RadialSlope<float> radial_slope(const RadialTerms<float>& terms, const float p_m[3]) noexcept {
  return radial_slope_scalar(terms, p_m);
}
RadialSlope<double> radial_slope(const RadialTerms<double>& terms, const double p_m[3]) noexcept {
  return radial_slope_scalar(terms, p_m);
}
void solve_lower(const PackedLower& l, double* const x[3]) noexcept { solve_lower_scalar(l, x); }
void solve_upper(const PackedLower& l, double* x) noexcept { solve_upper_scalar(l, x); }
void rotate(const double* column, double* const others[3], double* moved, int count,
            const Rotations& by) noexcept {
  rotate_scalar(column, others, moved, count, by);
}
const char* instruction_set() noexcept { return "plain"; }

}  // namespace forcegrid::kriging
