// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <optional>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/reduced_model.h"

namespace forcegrid::simulator {

/// One state of a held object, as its full solver found it. Rows 3 i to 3 i + 2 are vertex i's.
struct ReducedSnapshot {
  Eigen::Vector3d displacement_W = Eigen::Vector3d::Zero();  ///< [m] of the tool since the grab
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();         ///< [N] on the tool
  Eigen::VectorXf moved_m;                                   ///< x - X, 3 numbers per vertex
  Eigen::MatrixX3f sensitivity;                              ///< S = dx/dP, 3 rows per vertex
};

/// What a reduced model is made from.
struct ReducedTrainingSet {
  std::vector<std::int32_t> patch;    ///< vertices that the tool holds, in the mesh's numbering
  Eigen::MatrixX3f rest_sensitivity;  ///< S at rest
  std::vector<ReducedSnapshot> snapshots;
};

/// The object's present state; `answer` is its last one. Allocates.
ReducedSnapshot take_snapshot(const SpringMesh& mesh, const ElasticObject<float>& object,
                              const Equilibrium& answer);

/// For an object that has just been grabbed and not moved yet. Allocates.
ReducedTrainingSet begin_training_set(const SpringMesh& mesh, const ElasticObject<float>& object);

/// Which states are worth keeping.
struct StateSpacing {
  double apart_m = 2e-3;         ///< smallest distance between the tool's positions
  std::size_t most_states = 80;  ///< more of them cost more memory and time than they are worth
};

/// Whether an answer is an equilibrium at least that far from rest and from every state of the set.
bool is_new_state(const Equilibrium& answer, double apart_m, const ReducedTrainingSet& set);

/// Adds the object's present state if it is new and there is room; `answer` is its last one.
/// Allocates.
/// @returns whether it was added.
bool add_state(const SpringMesh& mesh, const ElasticObject<float>& object,
               const Equilibrium& answer, const StateSpacing& spacing, ReducedTrainingSet& set);

struct ReducedTrainingOptions {
  /// Modes are added until the mean energy that the states lack is worth this fraction of the mean
  /// force over mode_length_m; in (0, 1).
  double mode_tolerance = 1e-4;
  double mode_length_m = 2e-3;
  int most_modes = 36;  ///< 1 to kMostReducedCoordinates - 3
  /// The search for springs ends at this RMS error of their forces over the training states, as a
  /// fraction of the RMS force; > 0.
  double cubature_tolerance = 1e-4;
  int most_springs = 600;                     ///< >= 1
  int candidate_springs = 4000;               ///< from which the springs are chosen; >= 1
  std::uint64_t seed = 1;                     ///< of the candidates' choice
  const std::atomic<bool>* cancel = nullptr;  ///< ends the training when set and true
};

/// Throws Error naming the option that is out of range.
void check(const ReducedTrainingOptions& options);

struct ReducedTraining {
  std::optional<ReducedModel> model;  ///< nothing when cancelled
  /// [m], [m/m]: column k is dx / dz_k; 3 rows per vertex.
  Eigen::MatrixXf basis;
  double lacking_energy_J = 0.0;  ///< energy in the modes left out, mean over the states
  double cubature_error = 0.0;    ///< the error reached, see cubature_tolerance
  double training_error = 0.0;    ///< RMS |F - F_full| over RMS |F_full|, over the training states
  double time_s = 0.0;            ///< wall time
};

/// Makes a reduced model of the states that a full solver went through.
///
/// *Modes*: the principal components of what S at rest leaves of the positions, x - X - S_0 P, and
/// of the sensitivities, (S - S_0) times 3 mm, in the norm of the object's stiffness at rest
/// (proper orthogonal decomposition). *Springs*: some thousand candidates are drawn in proportion
/// to their contribution. A few of them with weights >= 0 (find_sparse_weights) give, in every
/// training state, the same nonlinear generalised forces as all springs: those on the tool and,
/// weighted by their effect on it, those on the modes.
/// Source: Sirovich (1987) for the modes; An, Kim and James (2008) and Farhat et al. (2014) for the
/// springs.
/// Throws Error for options out of range, or for a set without states or of another mesh.
/// Real-time: no; 1 to 10 s. Threads: none of its own.
ReducedTraining train_reduced_model(const SpringMesh& mesh, const ReducedTrainingSet& set,
                                    const ReducedTrainingOptions& options = {});

}  // namespace forcegrid::simulator
