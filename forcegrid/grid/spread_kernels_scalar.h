// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/grid/spread_kernels.h"

namespace forcegrid {

// The plain C++ behind Instructions::kScalar; see spread_kernels.h for what they do.
void spread_force_scalar(const SpreadConstants& constants, const SpreadSample& sample,
                         const SegmentWork<ForceSegment>* work, std::size_t count) noexcept;
void spread_moments_scalar(const SpreadConstants& constants, const SpreadSample& sample,
                           const SegmentWork<MomentSegment>* work, std::size_t count) noexcept;
void fit_corners_scalar(const CornerMoments& corners, double ridge, CornerForces& forces) noexcept;

}  // namespace forcegrid
