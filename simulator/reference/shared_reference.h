// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/reference/reference_solution.h"

namespace forcegrid::simulator {

/// One tool's way through a run, on a clock that all tools share.
struct ToolPath {
  static constexpr double kNever_s = std::numeric_limits<double>::infinity();

  std::vector<double> times_s;               ///< [s] of its servo cycles, each later than the last
  std::vector<Eigen::Vector3d> positions_W;  ///< [m] one per time
  double touched_s = kNever_s;               ///< [s] from then on it holds its patch
  double let_go_s = kNever_s;                ///< [s] until then
  /// [m] Where it touched: ForceSample::contact_point_W_m of its samples.
  Eigen::Vector3d contact_point_W = Eigen::Vector3d::Zero();
  /// [m] One per tool: where it was when the object was last solved before this touch. Those that
  /// held the object then had deformed what this one takes hold of. Others are not used.
  std::vector<Eigen::Vector3d> tools_before_touch_W;
};

/// The reference forces of several tools on one object (SharedObject): for each tool the force at
/// every position of its path, with all tools where their paths have them at that time,
/// interpolated linearly between their own servo cycles. Same contact and force definition as the
/// simulator of several tools.
///
/// Each cycle of each tool is one solution of the object under all, so n tools cost about n * n
/// times what one does.
///
/// @param options  its contact point, first cycle and progress are those of all tools: the first
///                 two are not used.
/// @returns one per tool, in their order; forces are zero while the tool does not hold. Elapsed
///          time and threads are those of all together.
/// Throws Error for no tool, options out of range, paths whose times do not rise or whose numbers
/// are not finite, and a contact point without a vertex to hold.
/// Threads: starts up to options.threads and joins them before it returns.
std::vector<ReferenceSolution> simulate_shared_reference(const std::vector<ToolPath>& tools,
                                                         const ReferenceOptions& options);
std::vector<ReferenceSolution> simulate_shared_reference(const SpringMesh& mesh,
                                                         const std::vector<ToolPath>& tools,
                                                         const ReferenceOptions& options);

}  // namespace forcegrid::simulator
