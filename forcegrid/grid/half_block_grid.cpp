// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/grid_instances.h"
#include "forcegrid/grid/grid_method.h"

namespace forcegrid {

std::unique_ptr<ForceMethod> make_half_block_grid(const GridPlan& plan) noexcept {
  using Storage = BlockStorage<HalfSegment>;
  using Grid = ForceGrid<Storage, HalfSegment>;
  return allocated_method<Grid>(
      plan, Grid(plan.geometry, plan.weighting,
                 Storage(plan.geometry.cells.array() + 1, plan.counting(), plan.pool_blocks),
                 plan.interpolation, plan.instructions));
}

}  // namespace forcegrid
