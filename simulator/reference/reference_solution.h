// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct ReferenceOptions {
  std::string scene = "block";  ///< as in the run; not used when a mesh is given
  /// [m] Where the tool touched: ForceSample::contact_point_W_m of the run's samples.
  Eigen::Vector3d contact_point_W = Eigen::Vector3d::Zero();
  std::size_t first_contact_cycle = 0;  ///< index of the first position with contact
  double relative_tolerance = 1e-6;     ///< see SolverOptions; > 0
  double patch_radius_m = 0.012;        ///< as in the run; without a mesh the scene's is used
  /// [m] Longest step of a thread, both on the approach to its part of the path and within it.
  /// Short enough that every part stays on the branch of equilibria that starts at rest.
  double max_step_m = 1.5e-3;
  unsigned threads = 0;  ///< parts of the path solved at the same time; 0: one per processor
  /// Called on the calling thread about ten times a second, and at the end, with the fraction done
  /// in [0, 1] and an estimate of the time left [s].
  std::function<void(double done, double remaining_s)> progress;
  /// When set and true, the work ends within some hundredths of a second.
  const std::atomic<bool>* cancel = nullptr;
};

struct ReferenceSolution {
  std::vector<Eigen::Vector3d> forces_W;  ///< [N] F_o, one per position; zero before contact
  std::vector<std::uint8_t> known;        ///< 0 at positions that a cancelled run did not reach
  bool cancelled = false;
  std::size_t unconverged = 0;  ///< positions whose tolerance was not reached
  std::size_t branch_changes = 0;
  double worst_relative_residual = 0.0;
  /// [N] Largest difference between the forces of two threads at the position that they share. A
  /// tiny one shows that both parts lie on the same branch. 0 with one thread.
  double worst_seam_N = 0.0;
  double relative_tolerance = 0.0;  ///< of the options
  unsigned threads = 0;
  double elapsed_s = 0.0;

  /// Everything but the forces; units are in the keys.
  nlohmann::json to_json() const;
};

/// The solver, set so that it follows a path to convergence.
SolverOptions reference_solver_options(const ReferenceOptions& options);

/// The reference force F_o: the force on the tool at every position of a recorded path, with the
/// object in equilibrium to `relative_tolerance`, in double precision and warm started along the
/// path. Same object, contact and force definition as the 30 Hz simulator (ElasticObject).
///
/// @param positions_W  [m] the recorded path, one per servo cycle.
/// Throws Error for an unknown scene, options out of range, a position or contact point that is not
/// finite, a first cycle beyond the path, or a contact point without a vertex to hold.
/// Threads: starts up to options.threads and joins them before it returns.
ReferenceSolution simulate_reference(const std::vector<Eigen::Vector3d>& positions_W,
                                     const ReferenceOptions& options);
ReferenceSolution simulate_reference(const SpringMesh& mesh,
                                     const std::vector<Eigen::Vector3d>& positions_W,
                                     const ReferenceOptions& options);

}  // namespace forcegrid::simulator
