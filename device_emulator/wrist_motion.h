// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string_view>
#include <vector>

#include "device_emulator/recorded_path.h"

namespace forcegrid::emulator {

/// How the operator turns the wrist of a device that has one.
enum class WristMotionKind : std::uint8_t {
  kStill,  ///< not at all
  kTurn,   ///< 0.31, 0.23, 0.17 Hz in joints 1, 2, 3, by a third of the way to the nearer stop
  kTwist,  ///< joint 3 alone, as a screwdriver: 1 rad to one side and to the other every 4 s
};

#pragma GCC visibility push(default)
/// "still", "turn" or "twist". @throws std::invalid_argument listing the known names.
WristMotionKind parse_wrist_motion(std::string_view name);
#pragma GCC visibility pop

/// The wrist's joint angles [rad] over time, about those of the calibration pose. Continuous in
/// angle and, from zero, in speed. A recorded path that has the wrist's angles replaces the motion
/// and is continuous in angle.
/// Real-time: angle_rad() neither allocates, locks nor throws. Threads: const after construction.
class WristMotion {
 public:
  /// @param rest_rad g in the calibration pose. @param reach_rad the way from there to the nearer
  /// stop of each joint. @param path as the hand's; used if it has angles.
  WristMotion(WristMotionKind kind, const Eigen::Vector3d& rest_rad,
              const Eigen::Vector3d& reach_rad, std::vector<PathPoint> path);

  /// [rad] g, `time_s` [s] after the motion began; before: where it begins.
  [[nodiscard]] Eigen::Vector3d angle_rad(double time_s) const noexcept;

 private:
  WristMotionKind kind_;
  Eigen::Vector3d rest_rad_;
  Eigen::Vector3d reach_rad_;
  std::vector<PathPoint> path_;  ///< empty: the motion's own
};

}  // namespace forcegrid::emulator
