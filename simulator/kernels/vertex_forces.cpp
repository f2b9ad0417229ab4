// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/vertex_forces.h"

#include "simulator/kernels/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

FORCEGRID_INLINE Float4 sensitivity_lanes(float value) { return Float4{0.0F, value, value, value}; }

}  // namespace

void add_vertex_forces(std::span<const VertexForce> forces, const Lanes* state,
                       Lanes* residual) noexcept {
  for (std::size_t i = 0; i < forces.size(); ++i) {
    const VertexForce& at = forces[i];
    const float k = at.home_stiffness_N_per_m;
    for (int c = 0; c < 3; ++c) {
      const Float4 x = state[i].component[c];
      Float4 r = residual[i].component[c] - sensitivity_lanes(k) * x;
      const double from_home_m = static_cast<double>(x[0]) - at.rest_m[c];
      r[0] += static_cast<float>(at.load_N[c] - static_cast<double>(k) * from_home_m);
      residual[i].component[c] = r;
    }
  }
}

void add_vertex_forces(std::span<const VertexForce> forces, const Lanes* state,
                       const Precise* position, Precise* force, Lanes* residual) noexcept {
  for (std::size_t i = 0; i < forces.size(); ++i) {
    const VertexForce& at = forces[i];
    const float k = at.home_stiffness_N_per_m;
    for (int c = 0; c < 3; ++c) {
      force[i].xyz[c] +=
          at.load_N[c] - static_cast<double>(k) * (position[i].xyz[c] - at.rest_m[c]);
      Float4 r = residual[i].component[c] - sensitivity_lanes(k) * state[i].component[c];
      r[0] = static_cast<float>(force[i].xyz[c]);
      residual[i].component[c] = r;
    }
  }
}

void add_home_blocks(std::span<const VertexForce> forces, BlockInverse* block) noexcept {
  for (std::size_t i = 0; i < forces.size(); ++i) {
    const float k = forces[i].home_stiffness_N_per_m;
    block[i].diagonal += Float4{k, k, k, 0.0F};
  }
}

std::vector<float> home_stiffness_N_per_m(std::span<const VertexForce> forces) {
  std::vector<float> result;
  result.reserve(forces.size());
  for (const VertexForce& force : forces) {
    result.push_back(force.home_stiffness_N_per_m);
  }
  return result;
}

}  // namespace forcegrid::simulator::kernels
