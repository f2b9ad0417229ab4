// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "evaluation/objects/force_table.h"

namespace forcegrid::stability {

/// A force table of F = -K d, which the splines render exactly.
inline evaluation::ForceTable linear_table(double stiffness_N_per_m) {
  const evaluation::TableLattice lattice;
  std::vector<Eigen::Vector3d> forces_W;
  for (std::size_t i = 0; i < lattice.node_count(); ++i) {
    forces_W.emplace_back(-stiffness_N_per_m * lattice.node_W_m(i));
  }
  return {lattice, forces_W};
}

}  // namespace forcegrid::stability
