// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "link/surface_patch.h"

namespace forcegrid::servo {

/// A horizontal square of 40 mm, `below_m` under the patch's position and centred on it, which
/// yields along z alone with `stiffness_N_per_m`.
/// @param time_ns  CLOCK_MONOTONIC of the tool state that it answers
inline link::SurfacePatch square_patch(std::int64_t time_ns, double below_m,
                                       double stiffness_N_per_m) {
  link::SurfacePatch patch;
  patch.echo_servo_time_ns = time_ns;
  const auto z_m = static_cast<float>(-below_m);
  patch.vertex_count = 4;
  patch.vertices_W_m[0] = {-0.02F, -0.02F, z_m};
  patch.vertices_W_m[1] = {0.02F, -0.02F, z_m};
  patch.vertices_W_m[2] = {0.02F, 0.02F, z_m};
  patch.vertices_W_m[3] = {-0.02F, 0.02F, z_m};
  patch.triangle_count = 2;
  patch.triangles[0] = {0, 1, 2};
  patch.triangles[1] = {0, 2, 3};
  patch.has_stiffness = true;
  patch.stiffness_W_N_per_m[2] = static_cast<float>(-stiffness_N_per_m);
  return patch;
}

}  // namespace forcegrid::servo
