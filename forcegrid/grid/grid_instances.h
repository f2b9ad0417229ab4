// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "forcegrid/core/force_method.h"
#include "forcegrid/grid/grid_plan.h"

namespace forcegrid {

// The grid methods, one per kind of vertex and storage. Each is a translation unit of the same
// name, so that a device's own processor can use one of them alone and its code size can be
// measured (`cmake --build BUILD --target code_size`).
//
// All take a checked plan (make_grid_method()) and return null if there is not enough memory. They
// allocate; the methods that they return do not.

/// Forces at the vertices of one array over the whole workspace: `forcegrid`, `forcegrid+request`
/// and `forcegrid-tangent`. In dense_force_grid.cpp.
std::unique_ptr<ForceMethod> make_dense_force_grid(const GridPlan& plan) noexcept;
/// The same in blocks from a pool, only where samples came. In block_force_grid.cpp.
std::unique_ptr<ForceMethod> make_block_force_grid(const GridPlan& plan) noexcept;
/// The same with vertices in half precision, for a device's own processor. In half_block_grid.cpp,
/// which is not part of the library.
std::unique_ptr<ForceMethod> make_half_block_grid(const GridPlan& plan) noexcept;
/// The same in the paper's adaptive form. In adaptive_force_grid.cpp.
std::unique_ptr<ForceMethod> make_adaptive_force_grid(const GridPlan& plan) noexcept;
/// Moments of the samples at the vertices of one array: `forcegrid-mls`. In dense_mls_grid.cpp.
std::unique_ptr<ForceMethod> make_dense_mls_grid(const GridPlan& plan) noexcept;
/// The same in blocks from a pool. In block_mls_grid.cpp.
std::unique_ptr<ForceMethod> make_block_mls_grid(const GridPlan& plan) noexcept;

}  // namespace forcegrid
