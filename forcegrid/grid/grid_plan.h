// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "forcegrid/core/grid_geometry.h"
#include "forcegrid/core/radial_weight.h"
#include "forcegrid/grid/force_grid.h"
#include "forcegrid/grid/spread_kernels.h"

namespace forcegrid {

/// The parameters of a grid method, checked and with all defaults filled in.
struct GridPlan {
  const char* name = "";  ///< of the method; static text
  GridGeometry geometry;
  RadialWeight weighting;
  Interpolation interpolation = Interpolation::kTrilinear;
  Instructions instructions = Instructions::kBest;
  int samples_per_cell = 0;     ///< s; 0: no threshold
  bool requests = false;        ///< asks for forces around the tool
  bool stiffness = false;       ///< spreads F + J (v - P)
  double ridge = 1e-5;          ///< of the moments' fit, in units of r^2
  std::size_t pool_blocks = 0;  ///< of block storage

  bool counting() const noexcept { return samples_per_cell > 0 || requests; }
};

}  // namespace forcegrid
