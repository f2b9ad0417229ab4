// SPDX-License-Identifier: Apache-2.0
// In place of spread_kernels.cpp where there is neither Highway nor a vector unit.
#include "forcegrid/grid/spread_kernels.h"
#include "forcegrid/grid/spread_kernels_scalar.h"

namespace forcegrid {

SpreadKernel<ForceSegment> spread_force_kernel(Instructions /*instructions*/) noexcept {
  return spread_force_scalar;
}
SpreadKernel<MomentSegment> spread_moments_kernel(Instructions /*instructions*/) noexcept {
  return spread_moments_scalar;
}
FitCorners fit_corners_kernel(Instructions /*instructions*/) noexcept { return fit_corners_scalar; }
const char* best_instructions() noexcept { return "plain"; }

}  // namespace forcegrid
