// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

#include "simulator/kernels/force_model.h"
#include "simulator/kernels/spring_kernels.h"
#include "simulator/kernels/vertex_forces.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/neighbourhood.h"
#include "simulator/solver/region.h"

namespace forcegrid::simulator {

/// What one pass of evaluation finds; ElasticObject documents the equations.
struct Evaluation {
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();      ///< [N] F, work-consistent
  Eigen::Vector3d raw_force_W = Eigen::Vector3d::Zero();  ///< [N] sum over the patch alone
  Eigen::Matrix3d stiffness_W = Eigen::Matrix3d::Zero();  ///< [N/m] J
  double residual_N = 0.0;                                ///< |r| over the free vertices
  double sensitivity_residual_N_per_m = 0.0;              ///< |K S| over the free vertices
  double border_work_N = 0.0;                             ///< see SolverOptions::border_tolerance
  /// [N m] Sum over the patch of x_g r_g^T, positions from origin_W().
  Eigen::Matrix3d patch_moment_W_Nm = Eigen::Matrix3d::Zero();
  bool finite() const noexcept;
};

/// A correction by conjugate gradients.
struct Descent {
  bool unstable = false;  ///< K is not positive definite along some lane's direction
  int iterations = 0;     ///< done before that
};

/// A mass-spring object's positions x and sensitivities S = dx/dP, in SIMD lanes side by side, with
/// everything needed to predict, evaluate and correct them. The solver, ElasticObject, decides
/// which of these to do and when.
///
/// Positions are in W from origin_W(), so that single precision keeps its digits. Vertices have
/// numbers of their own here, which number_around_patch() changes: mesh_number(), own_number().
///
/// Real-time: no allocation except where said. Threads: one at a time.
template <typename Real>
class StateWithSensitivities {
 public:
  /// `mesh` must have passed check(). At rest, nothing held.
  explicit StateWithSensitivities(const SpringMesh& mesh);

  std::size_t vertex_count() const noexcept { return rest_.size(); }
  std::size_t spring_count() const noexcept { return springs_; }
  std::size_t memory_bytes() const noexcept;  ///< that it holds, itself included
  const Eigen::Vector3d& origin_W() const noexcept { return origin_W_; }
  const std::vector<std::int32_t>& patch() const noexcept { return patch_; }  ///< own numbers
  std::int32_t mesh_number(std::size_t own) const noexcept { return mesh_number_[own]; }
  std::size_t own_number(std::size_t mesh) const noexcept { return own_number_[mesh]; }
  Region& region() noexcept { return region_; }
  const Region& region() const noexcept { return region_; }
  std::int32_t evaluated_vertices() const noexcept { return extent_.active; }

  /// Calls visit(own number) for each vertex that a grab would hold.
  template <typename Visit>
  void visit_grabbable(const Eigen::Vector3d& point_W, double radius_m, Visit visit) const {
    const Eigen::Vector3d centre = point_W - origin_W_;
    for (std::size_t i = 0; i < rest_.size(); ++i) {
      if (fixed_[i] == 0 && (rest_[i] - centre).norm() <= radius_m) {
        visit(static_cast<std::int32_t>(i));
      }
    }
  }

  /// From the rest pose: these vertices (own numbers) follow the tool from now on. Allocates.
  /// @param number_around  first renumber the vertices ring by ring around them.
  void hold(std::vector<std::int32_t> patch, bool number_around);
  /// For one of several tools that hold the object (SharedObject): `patch` follows this state's
  /// tool from `anchor` [m, from the origin], where it stands without displacement; the vertices
  /// `others` are held elsewhere, where place_others() puts them, and S is zero there. Positions
  /// and the rest of S stay. The region must be the whole object, numbered as the mesh is.
  /// Allocates.
  /// @param anew  the tool has just taken hold: its displacement and S begin at zero.
  void share(std::vector<std::int32_t> patch, std::vector<Eigen::Vector3d> anchor,
             std::vector<std::int32_t> others, bool anew);
  /// [m, from the origin] Where share()'s `others` stand from the next advance_to() on.
  void place_others(const std::vector<Eigen::Vector3d>& place) noexcept;
  /// [m, from the origin] Where each vertex of the patch stands without displacement, from the next
  /// advance_to() on: for a tool that turns. As many as the patch has.
  void set_patch_anchor(const std::vector<Eigen::Vector3d>& anchor) noexcept;
  /// For a vertex that is held, as one whose place is not the tool's displacement alone.
  void set_sensitivity(std::size_t i, const Eigen::Matrix3d& sensitivity) noexcept {
    for (int c = 0; c < 3; ++c) {
      for (int j = 0; j < 3; ++j) {
        state_[i].component[c][1 + j] = static_cast<float>(sensitivity(c, j));
      }
    }
  }
  /// Whether nothing holds this vertex.
  bool is_free(std::size_t i) const noexcept { return free_[i] != 0; }
  /// Lets go: every vertex is at rest, the former state is forgotten, the region is the whole
  /// object.
  void release() noexcept;

  /// Builds the coarse half of the preconditioner for the present state. Allocates; after
  /// evaluate().
  void invert_coarse();

  const Eigen::Vector3d& displacement_W() const noexcept { return displacement_; }
  void forget_trend() noexcept { trend_valid_ = false; }
  void forget_preconditioner() noexcept { preconditioner_valid_ = false; }

  /// Keeps the present state for restore() and predicts the one at `displacement` of the tool:
  /// kernels::predict().
  void advance_to(const Eigen::Vector3d& displacement) noexcept;
  /// Returns to the state before the last advance_to().
  void restore() noexcept;
  /// The same with the patch at its new place: finite, whatever happened since.
  void restore_under_tool() noexcept;
  /// Every free vertex is at rest, and its S unknown; what is held stays in its place.
  void begin_at_rest() noexcept;

  /// Solves `levels` rings from now on. Vertices that join the region move to where the tool now
  /// is; vertices that leave it keep that place. Between moves, or to a larger region.
  void change_region(int levels) noexcept;

  /// ElasticObject::copy() and ElasticObject::correct(), the latter between moves.
  void copy(const std::vector<std::int32_t>& vertices, Neighbourhood& copy) const noexcept;
  void correct(const Neighbourhood& was, const Neighbourhood& is) noexcept;

  /// One pass over all springs of the region: residuals, tangents and their sums; every few
  /// millimetres also a new preconditioner.
  Evaluation evaluate() noexcept;

  /// -A^T K B over the vertices that are free or held, A the sensitivities of this state and B
  /// those of `other`, as of its last evaluate(): how the force that A stands for changes with what
  /// B stands for. Row: component of A's. Of second order in both errors. `other` has the same
  /// vertices in the same order, the whole object is its region.
  Eigen::Matrix3d mixed_stiffness(const StateWithSensitivities& other) const noexcept;

  /// Preconditioned conjugate gradients on all four lanes from evaluate()'s residual, until lane 0
  /// is at `residual_aim_N` and the others at `sensitivity_aim_N_per_m`.
  Descent descend(int max_iterations, double residual_aim_N,
                  double sensitivity_aim_N_per_m) noexcept;
  /// In double, lane 0 of the state holds a predicted or corrected change of the positions until
  /// this adds it.
  void absorb_correction() noexcept;

  /// [m] Where a vertex of the region is.
  Eigen::Vector3d position(std::size_t i) const noexcept;
  void set_position(std::size_t i, const Eigen::Vector3d& position) noexcept;
  /// [m] Where any vertex is; one outside the region follows S from where it was left.
  Eigen::Vector3d standing_position(std::size_t i) const noexcept;
  Eigen::Matrix3d sensitivity(std::size_t i) const noexcept;

  /// [J] The force models' energy, the home springs' and the loads'.
  double energy_J() noexcept;

  // For a search along a correction of the positions, which uses what restore() would need.
  void save() noexcept;                                          ///< the state to search from
  Eigen::Vector3d saved_position(std::size_t i) const noexcept;  ///< [m]
  /// [m] The change by descend() since save(). If descend() stopped at once, the direction that it
  /// began with; then S goes back to the saved one.
  void take_correction(bool from_direction, std::vector<Eigen::Vector3f>& correction) noexcept;

 private:
  static constexpr bool kDouble = std::is_same_v<Real, double>;

  void number_around_patch();
  void limit_models() noexcept;
  const typename ForceModel<Real>::Position* model_positions(std::int32_t count) noexcept;
  void stand_at_rest() noexcept;
  void place_patch() noexcept;
  void forget_trends() noexcept;
  void update_preconditioner() noexcept;
  double silence_border() noexcept;
  std::span<const kernels::VertexForce> active_forces() const noexcept;
  // A small region does without the coarse grid, which carries corrections far.
  const kernels::CoarseGrid& coarse() const noexcept {
    return region_.is_whole() ? coarse_ : no_coarse_;
  }
  kernels::StepSums take_step(kernels::Float4 alpha) noexcept;
  kernels::Float4 precondition_coarsely() noexcept;
  kernels::Float4 apply_stiffness() noexcept;
  void next_direction(kernels::Float4 beta, const kernels::CoarseGrid& coarse) noexcept;

  Eigen::Vector3d origin_W_;
  std::vector<Eigen::Vector3d> rest_;
  std::vector<std::uint8_t> fixed_;
  std::vector<std::uint8_t> free_;
  std::vector<std::int32_t> patch_;
  std::vector<Eigen::Vector3d>
      patch_anchor_;                  // where each vertex of the patch is at displacement 0
  std::vector<std::int32_t> others_;  // held by other tools
  std::vector<Eigen::Vector3d> others_place_;
  std::vector<std::int32_t> mesh_number_;  // by own number
  std::vector<std::size_t> own_number_;    // by the mesh's number
  Region region_;
  std::vector<std::int32_t> constrained_;  // fixed vertices and the patch
  std::vector<kernels::Lanes> pull_;       // what pulls on these, as residual_, by evaluate()
  std::size_t springs_ = 0;
  std::vector<std::unique_ptr<ForceModel<Real>>> models_;
  kernels::Extent extent_;
  std::vector<kernels::VertexForce> vertex_force_;  // empty: nothing but the models pulls
  std::vector<float> home_N_per_m_;                 // of vertex_force_

  std::vector<kernels::Lanes> state_;
  std::vector<kernels::Lanes> residual_;
  std::vector<kernels::Lanes> direction_;
  std::vector<kernels::Lanes> product_;
  std::vector<kernels::Lanes> saved_state_;
  std::vector<kernels::BlockInverse> inverse_;
  std::vector<kernels::Precise> position_;  // double only
  std::vector<kernels::Precise> saved_position_;
  std::vector<kernels::Precise> force_;
  std::vector<kernels::Single> single_position_;  // float only
  kernels::CoarseGrid coarse_;
  kernels::CoarseGrid no_coarse_;
  std::vector<kernels::Lanes> coarse_residual_;
  std::vector<kernels::Lanes> coarse_correction_;
  bool trend_valid_ = false;  // saved_state_ is a former state, saved_displacement_ its place
  bool preconditioner_valid_ = false;
  Eigen::Vector3d preconditioner_displacement_ = Eigen::Vector3d::Zero();

  Eigen::Vector3d displacement_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d saved_displacement_ = Eigen::Vector3d::Zero();
};

extern template class StateWithSensitivities<float>;
extern template class StateWithSensitivities<double>;

}  // namespace forcegrid::simulator
