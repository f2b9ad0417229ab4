// SPDX-License-Identifier: Apache-2.0
#include "simulator/kernels/spring_forces.h"

#include <cmath>

#include "simulator/kernels/coarse_correction.h"
#include "simulator/kernels/spring_kernels.h"

namespace forcegrid::simulator {

template <typename Real>
SpringForces<Real>::SpringForces(const SpringMesh& mesh)
    : table_(make_spring_table<Real>(mesh)), tangent_(table_.constants.size()) {
  if constexpr (std::is_same_v<Real, double>) {
    t_N_per_m_.resize(tangent_.size());
  }
}

template <typename Real>
std::size_t SpringForces<Real>::memory_bytes() const noexcept {
  const auto bytes = [](const auto&... vectors) {
    return (... + (vectors.capacity() * sizeof(*vectors.data())));
  };
  return sizeof *this + bytes(table_.rows.row_begin, table_.rows.owner, table_.rows.other,
                              table_.constants, table_.mesh_spring, tangent_, t_N_per_m_);
}

template <typename Real>
std::span<const std::int32_t> SpringForces<Real>::lower() const noexcept {
  return std::span(table_.rows.owner).first(table_.springs);
}
template <typename Real>
std::span<const std::int32_t> SpringForces<Real>::upper() const noexcept {
  return std::span(table_.rows.other).first(table_.springs);
}

template <typename Real>
void SpringForces<Real>::renumber(const std::vector<std::int32_t>& order) {
  renumber_springs(order, table_.rows, table_.constants);
}

template <typename Real>
void SpringForces<Real>::limit(const kernels::Extent& extent) noexcept {
  static_cast<kernels::Extent&>(table_.rows) = extent;
}

template <typename Real>
void SpringForces<Real>::evaluate(const kernels::Lanes* state, const Position* position,
                                  kernels::Precise* force, kernels::Lanes* residual) noexcept {
  if constexpr (std::is_same_v<Real, double>) {
    kernels::find_tangents(table_.rows, table_.constants.data(), table_.exponential, position,
                           t_N_per_m_.data(), tangent_.data());
    kernels::add_precise_forces(table_.rows, t_N_per_m_.data(), position, force);
  } else {
    kernels::find_tangents(table_.rows, table_.constants.data(), table_.exponential, position,
                           tangent_.data());
  }
  kernels::add_residuals(table_.rows, tangent_.data(), state, residual);
}

template <typename Real>
void SpringForces<Real>::add_blocks(kernels::BlockInverse* block) const noexcept {
  kernels::add_blocks(table_.rows, tangent_.data(), block);
}

template <typename Real>
kernels::Float4 SpringForces<Real>::apply_stiffness(const float* home_N_per_m,
                                                    const kernels::Lanes* direction,
                                                    kernels::Lanes* product) const noexcept {
  return kernels::apply_stiffness(table_.rows, tangent_.data(), home_N_per_m, direction, product);
}

template <typename Real>
void SpringForces<Real>::add_coarse_stiffness(const std::vector<std::uint8_t>& free,
                                              const kernels::CoarseGrid& coarse,
                                              Eigen::MatrixXf& stiffness) const {
  simulator::add_coarse_stiffness(table_.rows, tangent_, free, coarse, stiffness);
}

template <typename Real>
double SpringForces<Real>::energy_J(const Position* position) const noexcept {
  const auto at = [position](std::size_t i) {
    const auto& xyz = position[i].xyz;
    return Eigen::Vector3d(static_cast<double>(xyz[0]), static_cast<double>(xyz[1]),
                           static_cast<double>(xyz[2]));
  };
  const kernels::SpringRows& rows = table_.rows;
  double sum_J = 0.0;
  for (std::size_t a = 0; a + 1 < rows.row_begin.size(); ++a) {
    const Eigen::Vector3d here = at(a);
    for (std::int32_t s = rows.row_begin[a]; s < rows.row_begin[a + 1]; ++s) {
      const auto spring = static_cast<std::size_t>(s);
      const kernels::SpringConstants<Real>& law = table_.constants[spring];
      const auto inverse_length = static_cast<double>(law.inverse_length_per_m);
      const auto exponent = static_cast<double>(law.exponent);
      const Eigen::Vector3d there = at(static_cast<std::size_t>(rows.other[spring]));
      const double strain = (there - here).norm() * inverse_length - 1.0;
      const double root =
          exponent > 0.0 ? 2.0 * std::sinh(0.5 * exponent * strain) / exponent : strain;
      sum_J += static_cast<double>(law.scale_N) / inverse_length *
               (0.5 * root * root + 0.25 * static_cast<double>(law.cubic) * std::pow(strain, 4));
    }
  }
  return sum_J;
}

template class SpringForces<float>;
template class SpringForces<double>;

}  // namespace forcegrid::simulator
