// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "forcegrid/grid/grid_plan.h"

namespace forcegrid {

/// The methods of the grid family; GridMethod says what each does.
enum class GridMethodKind {
  kSilent,   ///< forcegrid
  kRequest,  ///< forcegrid+request
  kTangent,  ///< forcegrid-tangent
  kMls,      ///< forcegrid-mls
};

/// Checks the options and fills in the defaults. Uses grid, influence_radius_m, unit_m, weight
/// (paper; forcegrid-tangent idw6, forcegrid-mls idw4), samples_per_cell, interpolation, storage,
/// pool_blocks; forcegrid-mls: ridge (1e-5).
/// @throws std::invalid_argument for options that are unusable, alone or together, saying why and
///   what to use instead.
GridPlan plan_grid(GridMethodKind kind, const MethodOptions& options);

/// @throws as plan_grid(), and std::runtime_error when there is not enough memory.
std::unique_ptr<ForceMethod> make_grid_method(GridMethodKind kind, const MethodOptions& options);

}  // namespace forcegrid
