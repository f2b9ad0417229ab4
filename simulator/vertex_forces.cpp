#include "simulator/kernel_support.h"

namespace forcegrid::simulator::kernels {
namespace {

FORCEGRID_INLINE Float4 sensitivity_lanes(float value) { return Float4{0.0F, value, value, value}; }

FORCEGRID_MULTIVERSION void add_home_stiffness_to(const VertexForce* forces, std::size_t count,
                                                  const Lanes* direction, Lanes* product,
                                                  Float4* dot) noexcept {
  Float4 sum{};
  for (std::size_t i = 0; i < count; ++i) {
    const float k = forces[i].home_stiffness_N_per_m;
    for (int c = 0; c < 3; ++c) {
      const Float4 f = Float4{k, k, k, k} * direction[i].component[c];
      product[i].component[c] += f;
      sum += f * direction[i].component[c];
    }
  }
  *dot = sum;
}

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

Float4 add_home_stiffness(std::span<const VertexForce> forces, const Lanes* direction,
                          Lanes* product) noexcept {
  Float4 dot{};
  add_home_stiffness_to(forces.data(), forces.size(), direction, product, &dot);
  return dot;
}

}  // namespace forcegrid::simulator::kernels
