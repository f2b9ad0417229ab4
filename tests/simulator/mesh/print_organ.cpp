// SPDX-License-Identifier: Apache-2.0
// Prints a generated surface, exactly. Built with several sets of compiler flags, whose outputs a
// test compares.
#include <cstdio>

#include "simulator/mesh/organ_surface.h"

int main() {
  forcegrid::simulator::OrganOptions options;
  options.vertex_count = 1500;
  options.edge_count = 4800;
  const auto mesh = forcegrid::simulator::make_organ_surface(options);
  for (const auto& position_W : mesh.rest_position_W) {
    std::printf("%a %a %a\n", position_W.x(), position_W.y(), position_W.z());
  }
  for (const auto& spring : mesh.springs) {
    std::printf("%d %d %.12g\n", spring.a, spring.b, spring.stiffness_N_per_m);
  }
  for (const auto& triangle : mesh.triangles) {
    std::printf("%d %d %d\n", triangle[0], triangle[1], triangle[2]);
  }
}
