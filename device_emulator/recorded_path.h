// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace forcegrid::emulator {

/// Where a tool was at a time.
struct PathPoint {
  double time_s = 0.0;
  Eigen::Vector3d position_D = Eigen::Vector3d::Zero();  ///< [m]
};

/// Reads a path for the emulated hand: CSV with a header in which the columns time_s, x_m, y_m and
/// z_m occur, as in the forces.csv of `forcegrid run`; other columns are skipped.
/// @throws EmulatorError naming file, line and what was expected: all four columns, finite numbers,
///         rising times, at least two rows.
/// Real-time: no. Threads: any.
std::vector<PathPoint> read_recorded_path(const std::string& file);

/// How far the path has come at `time_s` since its first point, [m] frame D: on the straight line
/// between the points around it; zero before, the last one after.
/// @param path at least one point, times rising.
/// Real-time: no allocation, lock or throw; a binary search. Threads: any.
Eigen::Vector3d displacement_along(const std::vector<PathPoint>& path, double time_s) noexcept;

}  // namespace forcegrid::emulator
