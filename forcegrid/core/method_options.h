// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "forcegrid/core/grid_geometry.h"
#include "forcegrid/core/interpolation.h"
#include "forcegrid/core/radial_weight.h"

namespace forcegrid {

/// Where a grid's vertices live. Names: dense, blocks, adaptive.
enum class GridStorage {
  kDense,     ///< one array over the whole workspace
  kBlocks,    ///< blocks from a fixed pool, only where samples came
  kAdaptive,  ///< the paper's adaptive form: a dense grid that follows the tool inside a sparse one
};

/// Options of methods. Each method documents which of them it uses and ignores the others; an
/// absent value means the method's own default.
struct MethodOptions {
  GridGeometry grid;  ///< workspace and cells of the grid methods

  double influence_radius_m = 0.0;   ///< r; 0: a sixth of the workspace's x extent
  double unit_m = 1e-3;              ///< L of the paper's weight, see RadialWeight
  std::optional<WeightKind> weight;  ///< forcegrid: paper; forcegrid-mls: idw4; -tangent: idw6
  int samples_per_cell = 0;          ///< the paper's s; 0: no threshold
  Interpolation interpolation = Interpolation::kTrilinear;
  GridStorage storage = GridStorage::kDense;
  /// Blocks of block storage; 0: 64 MiB of them, or what four fills need up to 256 MiB.
  int pool_blocks = 0;
  std::optional<double> ridge;   ///< forcegrid-mls: 1e-5
  std::optional<double> nugget;  ///< kriging: noise variance [N^2] of a sample, 1e-5

  /// kriging: samples in its dictionary, 2 to 32 (kriging-store: 48), 32. The candidates of an
  /// ensemble have their own sizes.
  std::optional<int> samples;
  /// kriging: how far apart samples are kept, in distance (1 mm) or in force (0.1 N).
  std::optional<double> spacing_m, spacing_N;

  /// auto: what a cycle may cost on average, in bare trilinear reads; absent: what it takes.
  std::optional<double> budget_reads;

  /// forcegrid-kriging: h, between vertices, 2 to 20 mm, 4 mm.
  std::optional<double> vertex_spacing_m;

  /// [m] r with its default filled in.
  double influence_radius() const noexcept {
    return influence_radius_m > 0.0 ? influence_radius_m : (grid.max_W.x() - grid.min_W.x()) / 6.0;
  }
};

}  // namespace forcegrid
