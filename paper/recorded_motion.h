// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "evaluation/judge/judge.h"
#include "evaluation/traces/trace.h"
#include "paper/options.h"

namespace forcegrid::paper {

/// Makes the trace of a tool that holds an object from the first position on. The servo has its
/// positions and the reference forces at kServoRate_Hz. The simulator answers with the force at its
/// ticks of kSimulatorRate_Hz, each one period later.
/// @param forces_W [N] F_o at each of `positions_W` [m].
/// Threads: any.
evaluation::Trace trace_of_path(const std::vector<Eigen::Vector3d>& positions_W,
                                const std::vector<Eigen::Vector3d>& forces_W,
                                const Eigen::Vector3d& contact_point_W);

/// A tool that holds a scene's object and follows a motion, with the reference forces F_o: the
/// object solved at every servo instant to a relative residual of 1e-6, as in the paper.
struct RecordedMotion {
  std::string scene;
  std::string scene_title;
  std::string motion;
  evaluation::Trace trace;
  bool from_cache = false;
  double solved_s = 0.0;           ///< wall time of the solves in this call
  std::size_t unconverged = 0;     ///< positions that missed the tolerance
  std::size_t branch_changes = 0;  ///< positions at which the object jumped to another equilibrium
  double worst_seam_N = 0.0;       ///< largest difference where two threads' parts meet
  /// [m] Travel of the tool between two answers of the simulator: the longest, and the RMS.
  double longest_travel_m = 0.0;
  double rms_travel_m = 0.0;
};

/// @param scene as for evaluation::chart_scene(). @param motion one of
///         evaluation::trajectory_names() with a single contact from beginning to end.
/// @throws evaluation::ChartError for an unknown name, a motion of several contacts or a cache that
///         can't be written, evaluation::Stopped, simulator::Error.
RecordedMotion record_motion(const std::string& scene, const std::string& motion,
                             const PaperOptions& options);

/// Result of a method on such a recording, including its forces.
struct Played {
  std::string method;
  evaluation::Verdict verdict;
};
Played play(const std::string& method, const evaluation::Trace& trace);
/// The same with a method that was just made.
Played play(ForceMethod& method, const evaluation::Trace& trace);

/// RMS of |F - F_o| from `begin_s` to before `end_s`, in % of `reference_rms_N`; NaN without
/// instants.
double rms_error_percent(const evaluation::Trace& trace,
                         const std::vector<Eigen::Vector3d>& forces_W, double begin_s, double end_s,
                         double reference_rms_N);

}  // namespace forcegrid::paper
