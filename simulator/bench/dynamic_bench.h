// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// [J] Energy of the springs (none at natural length), elements (none without strain), home
/// springs, loads (none at rest) and the vertices' motion.
double energy_J(const SpringMesh& mesh, const std::vector<Eigen::Vector3d>& position_W,
                const std::vector<Eigen::Vector3d>& velocity_W);

/// Measurements of DynamicObject with one time step.
struct DynamicRow {
  double step_s = 0.0;
  std::size_t steps = 0;  ///< along the motion
  double mean_ms = 0.0;   ///< processor time of one step
  double max_ms = 0.0;    ///< the largest mean over one move's steps
  double iterations_mean = 0.0;
  double unconverged = 0.0;  ///< fraction of the moves
  /// |F - F_converged| in % of |F_converged|, after the tool has stood still for static_after_s.
  double static_error_percent = 0.0;
  double static_after_s = 0.0;
  double released_J = 0.0;            ///< energy above that at rest when the tool lets go
  double after_100ms_percent = 0.0;   ///< part of it that is left after 0.1 s
  double largest_rise_percent = 0.0;  ///< of it, from one step to the next in 0.5 s; 0: never rose
};

/// Moves a tool that holds the scene's top along the displacements, one per 1 / `rate_Hz`, with
/// steps of 1, 2 and 4 ms and of the whole 1 / rate_Hz. Then it holds the tool still at the last
/// one, compares with ElasticObject<double>'s equilibrium, and lets go.
/// @param displacements_W  [m] since the grab; not empty.
/// @returns no rows for a scene without masses.
/// Throws Error for a scene whose top can't be held, or an empty motion.
std::vector<DynamicRow> bench_dynamic(const Scene& scene,
                                      const std::vector<Eigen::Vector3d>& displacements_W,
                                      double rate_Hz,
                                      const std::function<void(const std::string&)>& say);

}  // namespace forcegrid::simulator
