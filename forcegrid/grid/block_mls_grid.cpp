// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/grid_instances.h"
#include "forcegrid/grid/grid_method.h"
#include "forcegrid/grid/mls_grid.h"

namespace forcegrid {

std::unique_ptr<ForceMethod> make_block_mls_grid(const GridPlan& plan) noexcept {
  using Grid = MlsGrid<BlockStorage<MomentSegment>>;
  return allocated_method<Grid>(
      plan, Grid(plan.geometry, plan.weighting, plan.ridge,
                 BlockStorage<MomentSegment>(plan.geometry.cells.array() + 1, plan.counting(),
                                             plan.pool_blocks),
                 plan.instructions));
}

}  // namespace forcegrid
