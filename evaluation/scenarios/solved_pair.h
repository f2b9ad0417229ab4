// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "forcegrid/core/pair_force_method.h"
#include "simulator/mesh/scene.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/shared_object.h"

namespace forcegrid::evaluation {

/// The scene of this name where first_contact_point_W() is its origin.
/// @throws simulator::Error for one that can't be made, or whose tool slides or turns: `purpose`
/// needs forces that depend on positions alone.
simulator::Scene make_elastic_scene(const std::string& name, const std::string& purpose);

/// A mesh that two tools hold from the start, where PairMotion touches, solved under both.
/// Threads: one.
template <typename Real>
class SolvedPair {
 public:
  /// @param patch_radius_m of each tool's grip.
  /// @throws ChartError for tools that have nothing to hold; simulator::Error for a mesh that can't
  /// be solved.
  SolvedPair(const simulator::SpringMesh& mesh, const simulator::SolverOptions& options,
             double patch_radius_m);

  /// Solves with both tools there. @param displacements_m of both from where they touched.
  void move(const PairVector& displacements_m);
  /// [N] On both tools.
  PairVector forces_N() const;
  /// [N/m] dF_i/dP_j by the solver's linearisation; nothing if it has not converged.
  std::optional<PairMatrix> stiffness_N_per_m() const;
  bool converged() const;
  bool left_branch() const;  ///< the object snapped into another equilibrium on the way

 private:
  simulator::SharedObject<Real> object_;
};

extern template class SolvedPair<float>;
extern template class SolvedPair<double>;

}  // namespace forcegrid::evaluation
