// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "simulator/mesh/lattice_block.h"

namespace forcegrid::simulator::testing {

inline const Eigen::Vector3d kTop_W{0.02, 0.03, 0.04};

/// 6 x 6 x 5 vertices 20 mm apart; the tool of 12 mm holds none of them at the top's centre, so use
/// kGrip_m, which holds four on the surface.
inline constexpr double kGrip_m = 0.016;

inline SpringMesh block_with(double random_spread, double cubic_coefficient,
                             std::uint64_t seed = 1) {
  LatticeBlockOptions options;
  options.vertex_count = {6, 6, 5};
  options.stiffness_N_per_m = 20.0;
  options.random_spread = random_spread;
  options.seed = seed;
  options.top_centre_W = kTop_W;
  options.law = {.cubic_coefficient = cubic_coefficient};
  return make_lattice_block(options);
}

}  // namespace forcegrid::simulator::testing
