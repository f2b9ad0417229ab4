// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "evaluation/motions/trajectories.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/objects/object_effect.h"
#include "forcegrid/core/force_method.h"

namespace forcegrid::evaluation {

/// What the force of a touched object depends on besides the tool's motion: what changes without
/// notice.
struct ForceLaw {
  double factor = 1.0;      ///< of the object's force: of the place, times that of the cuts
  double slid_until_s = 0;  ///< [s] the object is where it has slid to at this time
  std::vector<bool> walls;  ///< those that are there, in the order of SceneExtras::walls
};

/// Force of object and walls on a tool that follows a trajectory.
/// Threads: const after construction. `trajectory` and `table` must outlive it.
class TouchedObject {
 public:
  TouchedObject(const Trajectory& trajectory, const ForceTable& table, const SceneExtras& extras,
                double servo_rate_Hz);

  /// The law that holds at `time_s`.
  ForceLaw law(double time_s) const;
  /// What the force at `time_s` and `position_W` tells one who knew `known`: the walls that push
  /// there, and where the object is and how stiff.
  ForceLaw law_with_sample(const ForceLaw& known, double time_s,
                           const Eigen::Vector3d& position_W) const;

  /// On a tool at rest at `position_W`.
  /// @throws ChartError for a displacement that the table does not cover.
  Sample answer(double time_s, const Eigen::Vector3d& position_W) const;
  /// On the moving tool.
  /// @throws as answer().
  Sample answer_on_path(double time_s, const Eigen::Vector3d& position_W) const;
  /// [N] The same force, if `law` held. Relaxation is that of the true forces.
  /// @throws as answer().
  Eigen::Vector3d force_on_path_W(double time_s, const Eigen::Vector3d& position_W,
                                  const ForceLaw& law) const;

  /// Where a tool that wants to be at `position_W` gets to: the nearest position that the table
  /// covers.
  Eigen::Vector3d reached_W(double time_s, const Eigen::Vector3d& position_W) const;

 private:
  ForceTable::Value untouched(const Eigen::Vector3d& displacement_W) const;
  Sample elastic(double time_s, const Eigen::Vector3d& position_W, const ForceLaw& law) const;
  Sample at_rest(double time_s, const Eigen::Vector3d& position_W, const ForceLaw& law) const;
  Sample on_path(double time_s, const Eigen::Vector3d& position_W, const ForceLaw& law) const;
  Eigen::Vector3d velocity_W(double time_s) const noexcept;
  void remember_path();

  const Trajectory& trajectory_;
  const ForceTable& table_;
  SceneExtras extras_;
  double servo_rate_Hz_;
  Eigen::Vector3d slid_at_first_N_ = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3d> lags_N_;  ///< sum_j g_j L_j at each servo instant
};

}  // namespace forcegrid::evaluation
