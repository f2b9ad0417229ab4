// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/motions/trajectories.h"
#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::evaluation {

/// Motions of two tools that hold one object from t = 0 on, 50 mm apart on its top: the left one at
/// (0, -25, 0) mm from first_contact_point_W(), the right one at (0, 25, 0) mm. Each follows a
/// Trajectory of one tool, at 0.6 of its size so that the tools' patches do not meet:
///
///   name           left               right
///   lissajous      lissajous          lissajous, mirrored in y, 3.7 s ahead
///   random         random             random of another seed
///   hold_random    hold               random
///   hold_chirp     hold               chirp_oblique
///   stretch        chirp_oblique      the same, mirrored in x and y
///   poke           poke               poke, 0.4 s later
///
/// Every motion begins and holds for Trajectory's duration. Both tools start at rest where they
/// touched.
/// Threads: const after construction.
class PairMotion {
 public:
  /// @throws ChartError for an unknown name, listing the known ones.
  explicit PairMotion(const std::string& name, std::uint64_t seed = 1);

  const std::string& name() const noexcept { return name_; }
  /// [m] Where the tools touch.
  static PairVector contact_points_W() noexcept;
  /// [m] at `time_s` in 0 to 16 s.
  PairVector positions_W(double time_s) const noexcept;

  static constexpr double kLongest_s = 16.0;

 private:
  struct Tool {
    Trajectory motion;
    Eigen::Vector3d scale;  ///< of each axis; negative: mirrored
    double ahead_s = 0.0;   ///< of the trajectory's own time; negative: it begins later
  };

  static std::array<Tool, 2> tools_of(const std::string& name, std::uint64_t seed);

  std::string name_;
  std::array<Tool, 2> tools_;
};

/// In the order of the table above.
const std::vector<std::string>& pair_motion_names();

}  // namespace forcegrid::evaluation
