// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/mesh/lattice_block.h"
#include "simulator/mesh/scene.h"
#include "simulator/mesh/vertex_masses.h"

namespace forcegrid::simulator::testing {

/// A block of 48 x 48 x 36 mm with 100 masses, 50 g in all, whose springs have dampers of 10 ms;
/// its top is at the origin.
inline Scene little_jelly() {
  LatticeBlockOptions options;
  options.vertex_count = {5, 5, 4};
  options.size_m = {0.048, 0.048, 0.036};
  options.stiffness_N_per_m = 15.0;
  options.random_spread = 0.2;
  options.law.cubic_coefficient = 2.0;
  Scene scene;
  scene.name = "little_jelly";
  scene.description = "for tests";
  scene.patch_radius_m = 0.013;
  scene.mesh = make_lattice_block(options);
  give_dynamics(scene.mesh, {.mass_kg = 0.05, .retardation_time_s = 0.01});
  return scene;
}

}  // namespace forcegrid::simulator::testing
