// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

#include "simulator/kernels/coarse_kernels.h"
#include "simulator/kernels/lanes.h"
#include "simulator/kernels/spring_laws.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// What makes an object elastic, as the solver sees it: springs, or finite elements. It is a sum
/// over pairs of vertices. With H_ij the 3 x 3 block of a pair (i < j) and d = y_i - y_j,
///
///   (K y)_i += H_ij d,   (K y)_j -= H_ij^T d
///
/// so that K leaves translations alone to the last digit. All arrays have one entry per vertex, in
/// the numbering of the last renumber(). An object may have several models; each adds its part.
///
/// Real-time: no allocation except where said. Threads: one at a time.
template <typename Real>
class ForceModel {
 public:
  /// Positions [m] in the precision of forces.
  using Position =
      std::conditional_t<std::is_same_v<Real, double>, kernels::Precise, kernels::Single>;

  ForceModel() = default;
  ForceModel(const ForceModel&) = delete;
  ForceModel& operator=(const ForceModel&) = delete;
  virtual ~ForceModel() = default;

  virtual std::size_t memory_bytes() const noexcept = 0;  ///< that it holds, itself included

  /// The pairs of vertices that act on each other: two lists of the same size.
  virtual std::span<const std::int32_t> lower() const noexcept = 0;
  virtual std::span<const std::int32_t> upper() const noexcept = 0;

  /// Vertex order[n] becomes number n. Allocates.
  virtual void renumber(const std::vector<std::int32_t>& order) = 0;

  /// Work on this part of the object from now on.
  virtual void limit(const kernels::Extent& extent) noexcept = 0;

  /// Evaluates the state: stores K and adds
  ///   to lane 0 of `residual`     in float: the forces [N] on the vertices
  ///   to `force`                  in double: the same; in float null
  ///   to lanes 1-3 of `residual`  -(K S)_j, S from lanes 1-3 of `state`.
  virtual void evaluate(const kernels::Lanes* state, const Position* position,
                        kernels::Precise* force, kernels::Lanes* residual) noexcept = 0;

  /// Adds K's diagonal blocks, as positive as the model can cheaply make them, for the
  /// preconditioner.
  virtual void add_blocks(kernels::BlockInverse* block) const noexcept = 0;

  /// product += K direction, K as the last evaluate() found it.
  /// @param home_N_per_m  each vertex's home spring to add as well; null: none.
  /// @returns the lanes' dot products direction . product of all that `product` then holds.
  virtual kernels::Float4 apply_stiffness(const float* home_N_per_m,
                                          const kernels::Lanes* direction,
                                          kernels::Lanes* product) const noexcept = 0;

  /// Adds P^T K P to the lower triangle of `stiffness`, see coarse_correction.h. Allocates.
  virtual void add_coarse_stiffness(const std::vector<std::uint8_t>& free,
                                    const kernels::CoarseGrid& coarse,
                                    Eigen::MatrixXf& stiffness) const = 0;

  /// [J] of the whole object, whatever the limits.
  virtual double energy_J(const Position* position) const noexcept = 0;
};

/// The models of a mesh that has passed check(): of its springs and its elements, where it has any.
template <typename Real>
std::vector<std::unique_ptr<ForceModel<Real>>> make_force_models(const SpringMesh& mesh);

extern template std::vector<std::unique_ptr<ForceModel<float>>> make_force_models(
    const SpringMesh&);
extern template std::vector<std::unique_ptr<ForceModel<double>>> make_force_models(
    const SpringMesh&);

}  // namespace forcegrid::simulator
