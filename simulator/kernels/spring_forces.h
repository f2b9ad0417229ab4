// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "simulator/kernels/force_model.h"
#include "simulator/kernels/spring_table.h"

namespace forcegrid::simulator {

/// The springs of a mesh as a ForceModel.
template <typename Real>
class SpringForces final : public ForceModel<Real> {
 public:
  using typename ForceModel<Real>::Position;

  /// `mesh` must have passed check() and have springs.
  explicit SpringForces(const SpringMesh& mesh);

  std::size_t memory_bytes() const noexcept override;
  std::span<const std::int32_t> lower() const noexcept override;
  std::span<const std::int32_t> upper() const noexcept override;
  void renumber(const std::vector<std::int32_t>& order) override;
  void limit(const kernels::Extent& extent) noexcept override;
  void evaluate(const kernels::Lanes* state, const Position* position, kernels::Precise* force,
                kernels::Lanes* residual) noexcept override;
  void add_blocks(kernels::BlockInverse* block) const noexcept override;
  kernels::Float4 apply_stiffness(const float* home_N_per_m, const kernels::Lanes* direction,
                                  kernels::Lanes* product) const noexcept override;
  void add_coarse_stiffness(const std::vector<std::uint8_t>& free,
                            const kernels::CoarseGrid& coarse,
                            Eigen::MatrixXf& stiffness) const override;
  /// k l0^2 (2 (sinh(a e / 2) / a)^2 + c e^4 / 4) of each spring, which is
  /// k l0^2 (e^2 / 2 + c e^4 / 4) for a = 0.
  double energy_J(const Position* position) const noexcept override;

 private:
  SpringTable<Real> table_;
  std::vector<kernels::SpringTangent> tangent_;
  std::vector<double> t_N_per_m_;  // double only
};

extern template class SpringForces<float>;
extern template class SpringForces<double>;

}  // namespace forcegrid::simulator
