// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "forcegrid/grid/grid_plan.h"
#include "profiles/device_profile.h"

namespace forcegrid::firmware {

/// A grid that fits a microcontroller: vertices 5 mm apart over the device's workspace, samples
/// that reach 15 mm, blocks of half precision. A sample reaches 8 blocks of 4 KB; the pool has 11.
/// Tests on the host make the same one.
inline GridPlan small_grid(const profiles::DeviceProfile::Limits& limits) noexcept {
  constexpr double kSpacing_m = 0.005;
  constexpr double kRadius_m = 0.015;
  constexpr std::size_t kPoolBlocks = 11;
  GridPlan plan;
  plan.name = "forcegrid";
  plan.geometry.min_W = Eigen::Vector3d::Map(limits.workspace_min_m.data());
  plan.geometry.max_W = Eigen::Vector3d::Map(limits.workspace_max_m.data());
  plan.geometry.cells =
      ((plan.geometry.max_W - plan.geometry.min_W) / kSpacing_m).array().round().cast<int>();
  plan.weighting.influence_radius_m = kRadius_m;
  plan.weighting.mean_spacing_m = kSpacing_m;
  plan.instructions = Instructions::kScalar;
  plan.pool_blocks = kPoolBlocks;
  return plan;
}

}  // namespace forcegrid::firmware
