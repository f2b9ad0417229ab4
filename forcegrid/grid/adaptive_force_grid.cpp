// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/adaptive_grid.h"
#include "forcegrid/grid/grid_instances.h"
#include "forcegrid/grid/grid_method.h"

namespace forcegrid {

std::unique_ptr<ForceMethod> make_adaptive_force_grid(const GridPlan& plan) noexcept {
  using Grid = AdaptiveGrid;
  return allocated_method<Grid>(plan, Grid(plan.geometry, plan.weighting, plan.counting(),
                                           plan.interpolation, plan.instructions));
}

}  // namespace forcegrid
