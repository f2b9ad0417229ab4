// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "simulator/kernels/spring_kernels.h"
#include "simulator/kernels/vertex_forces.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/contact_law.h"

namespace forcegrid::simulator {

/// What a tool does to one material point: its force and stiffness act on the point's vertices by
/// the weights.
struct PointLoad {
  std::int32_t point = 0;
  std::array<std::int32_t, 3> vertex{};
  std::array<double, 3> weight{};
  Reaction reaction;
  /// [N/m] The known part of d force_W / dP beside stiffness_W (I - S_p): ContactPoint::pull_W.
  Eigen::Matrix3d known_pull_W = Eigen::Matrix3d::Zero();
  /// How the tool moves at that point with what the sensitivities are for: I for its position P;
  /// -[x_p - P]x for its rotation, whose sensitivities are T (PressedTurning).
  Eigen::Matrix3d tool_motion_W = Eigen::Matrix3d::Identity();
};

/// The springs of an object under forces that depend on the places of a few surface points: the
/// other half of PressedObject. Positions are in double precision, corrections and the
/// sensitivities S = dx/dP in single. Coordinates are from the object's own origin, along W's axes.
///
///   r = -dE/dx + sum_p w_p R_p,   (K + sum_p w_p C_p w_p^T) dx = r,
///   (the same matrix) S = w_p (C_p + L_p)
///
/// with C_p = Reaction::stiffness_W and L_p = known_pull_W (and C_p M_p for a tool_motion_W M_p
/// that is not I): four right-hand sides in SIMD lanes, conjugate gradients with block-Jacobi and a
/// coarse grid fitted at rest. Source: the kernels of ElasticObject. Real-time: no allocation after
/// construction. Threads: one.
class PressedSprings {
 public:
  /// `mesh` must have passed check().
  explicit PressedSprings(const SpringMesh& mesh);

  std::size_t vertex_count() const noexcept { return rest_.size(); }
  std::size_t spring_count() const noexcept { return springs_; }
  Eigen::Vector3d position(std::size_t vertex) const noexcept;  ///< [m]
  Eigen::Matrix3d sensitivity(std::size_t vertex) const noexcept;
  /// [N/m] A third of the trace of a vertex's own block of K, at rest.
  double stiffness_at_rest_N_per_m(std::size_t vertex) const noexcept {
    return stiffness_at_rest_N_per_m_[vertex];
  }

  /// Reserves room for this many loads, so that evaluate() need not allocate.
  void reserve(std::size_t loads) { loads_.reserve(loads); }

  void rest() noexcept;  ///< returns to the rest pose
  /// Moves to the positions of another of the same mesh; S stays.
  void take_positions(const PressedSprings& other) noexcept;
  bool at_rest() const noexcept { return at_rest_; }

  /// Keeps the state for restore(), then x += S step [m].
  void predict(const Eigen::Vector3d& step) noexcept;
  void restore() noexcept;

  /// Forces and tangents at the present state under `loads`.
  /// @param convex  leaves out of the matrix what compressed springs and turning normals subtract
  ///   from it. It is then positive definite, and every correction leads downhill in energy.
  void evaluate(const std::vector<PointLoad>& loads, bool convex) noexcept;

  double residual_N() const noexcept { return residual_N_; }    ///< |r| on free vertices
  double force_gap_N() const noexcept { return force_gap_N_; }  ///< |sum S_i^T r_i|
  /// [N/m] Residual of the equations for S on free vertices.
  double sensitivity_residual_N_per_m() const noexcept { return sensitivity_N_per_m_; }
  bool finite() const noexcept;

  struct Descent {
    int iterations = 0;
    bool unstable = false;  ///< the matrix is not positive definite: x and S are unchanged
  };
  /// Moves x, and S too, by the solution that conjugate gradients find after evaluate(), until both
  /// aims are met.
  Descent descend(int max_iterations, double residual_aim_N,
                  double sensitivity_aim_N_per_m) noexcept;

  /// Keeps only `factor` of the last descent's move of x; S keeps all of its own.
  void shorten(double factor) noexcept;

 private:
  void make_convex() noexcept;
  void add_loads() noexcept;
  void fit_preconditioner() noexcept;
  kernels::Float4 apply_loads() noexcept;
  void absorb_correction() noexcept;
  void forget_direction() noexcept;

  std::size_t springs_ = 0;
  std::vector<Eigen::Vector3d> rest_;
  std::vector<std::uint8_t> free_;
  std::vector<std::size_t> fixed_;
  kernels::SpringRows rows_;
  std::vector<kernels::SpringConstants<double>> constants_;
  bool exponential_ = false;
  std::vector<kernels::VertexForce> vertex_force_;
  std::vector<float> home_N_per_m_;  // of vertex_force_
  kernels::CoarseGrid coarse_;
  double mean_length_m_ = 0.0;
  std::vector<double> stiffness_at_rest_N_per_m_;

  std::vector<PointLoad> loads_;  ///< of the last evaluate(), for its matrix
  std::vector<kernels::Lanes> state_, saved_state_, state_before_, residual_, direction_, product_,
      coarse_residual_, coarse_correction_;
  std::vector<kernels::Precise> position_, saved_position_, base_position_, force_;
  std::vector<Eigen::Vector3f> correction_;  ///< [m] of the last descent, from base_position_
  std::vector<double> t_N_per_m_;
  std::vector<kernels::SpringTangent> tangent_;
  std::vector<kernels::BlockInverse> block_, inverse_;
  bool at_rest_ = true;
  bool saved_at_rest_ = true;
  double residual_N_ = 0.0;
  double force_gap_N_ = 0.0;
  double sensitivity_N_per_m_ = 0.0;
};

}  // namespace forcegrid::simulator
