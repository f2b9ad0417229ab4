// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "simulator/kernels/element_kernels.h"
#include "simulator/kernels/force_model.h"

namespace forcegrid::simulator {

/// The linear tetrahedra of a mesh as a ForceModel. Elements are evaluated side by side and their
/// exact Hessian is assembled into one 3 x 3 block per edge, which conjugate gradients then use as
/// they use springs. K is not projected. Only the blocks of the preconditioner fall back to a
/// scalar where they are not positive definite, see kernels::invert_block().
template <typename Real>
class ElementForces final : public ForceModel<Real> {
 public:
  using typename ForceModel<Real>::Position;

  /// `mesh` must have passed check() and have elements.
  explicit ElementForces(const SpringMesh& mesh);

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
  double energy_J(const Position* position) const noexcept override;

  /// evaluate() without sensitivities: `residual` gets forces in float and is not touched in
  /// double.
  void evaluate_forces(const Position* position, kernels::Precise* force,
                       kernels::Lanes* residual) noexcept;
  /// The edges and their H, as evaluated last.
  const kernels::SpringRows& rows() const noexcept { return rows_; }
  const std::vector<kernels::EdgeStiffness>& edges() const noexcept { return edge_; }

 private:
  void lay_out();
  void number_edges();
  void fill_batch(kernels::ElementBatch<Real>& batch, const std::vector<std::int32_t>& element);

  std::vector<ElementMaterial> materials_;
  std::vector<Eigen::Vector3d> unstrained_m_;  // in the present numbering
  std::vector<Tetrahedron> elements_;          // corners sorted, by their lowest one
  kernels::SpringRows rows_;                   // of the edges
  std::vector<kernels::EdgeStiffness> edge_;
  std::vector<kernels::ElementBatch<Real>> batches_;
};

extern template class ElementForces<float>;
extern template class ElementForces<double>;

}  // namespace forcegrid::simulator
