// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::emulator {

/// Where a tool was at a time.
struct PathPoint {
  double time_s = 0.0;
  Eigen::Vector3d position_D = Eigen::Vector3d::Zero();  ///< [m]
  /// [rad] Joint angles of the wrist; of all points of a path or of none.
  std::optional<Eigen::Vector3d> gimbal_rad{};
};

#pragma GCC visibility push(default)
/// Reads a path for the emulated hand: CSV with a header that names the columns time_s, x_m, y_m
/// and z_m, as in the forces.csv of `forcegrid run`. The columns gimbal_1_rad, gimbal_2_rad and
/// gimbal_3_rad, if they are there, are the wrist's joint angles. Other columns are skipped.
/// @throws EmulatorError naming file, line and what was expected: all four columns, all or none of
///   the wrist's, finite numbers, increasing times, at least two rows.
/// Real-time: no. Threads: any.
std::vector<PathPoint> read_recorded_path(const std::string& file);
#pragma GCC visibility pop

/// [m] Displacement along the path `time_s` after its first point, frame D: linear between the
/// points around it; zero before the first point, the last displacement after the last.
/// @param path at least one point, increasing times.
/// Real-time: no allocation, lock or throw; a binary search. Threads: any.
Eigen::Vector3d displacement_along(const std::vector<PathPoint>& path, double time_s) noexcept;

/// [rad] The wrist's joint angles there, likewise, of a path that has them.
Eigen::Vector3d gimbal_along(const std::vector<PathPoint>& path, double time_s) noexcept;

}  // namespace forcegrid::emulator
