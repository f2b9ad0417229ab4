// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "forcegrid/kriging/tool_motion.h"

namespace forcegrid::kriging {

/// Chooses where to ask the simulator: where a field knows least of what the tool will need soon.
///
/// In contact the points are along the predicted motion, one to three sample periods ahead, and at
/// one of six points 6 mm beside the tool, in turn. The one with the largest deviation * exp(-|P -
/// tool|^2 / (2 (12 mm)^2)) is asked. Before an expected contact it is the first of thirteen fixed
/// displacements from the contact point where the field knows too little.
///
/// No point is asked where the deviation is at most kAsk_N, before contact kAskBefore_N, nor
/// within 3 mm and 0.3 s of another.
/// See docs/kriging.md, "Uncertainty, status, requests".
/// Cost: four deviations per call in contact, at most thirteen before. Real-time: nothing
/// allocates, locks or throws.
class FieldRequests {
 public:
  /// [N] From this deviation on, a request is worth its cost.
  static constexpr double kAsk_N = 0.05;
  static constexpr double kAskBefore_N = 0.1;  ///< the same before contact
  static constexpr double kAskAgain_s = 0.3;
  static constexpr double kAskApart_m = 0.003;
  static constexpr double kReach_m = 0.012;     ///< within which points matter
  static constexpr double kFurthest_m = 0.015;  ///< ahead of the tool
  static constexpr double kBeside_m = 0.006;

  /// Forgets the requests made: call for another contact, made or expected.
  void begin_contact() noexcept { asked_.fill(Asked{}); }

  /// From now on requests ask at the points of a lattice. @param corner_m one of its points,
  /// relative to the contact's origin.
  void ask_on_lattice(const Eigen::Vector3d& corner_m, double spacing_m) noexcept {
    lattice_corner_m_ = corner_m;
    lattice_spacing_m_ = spacing_m;
  }

  /// In contact. @param position_W of the tool; `origin_W` of the contact.
  /// @param deviation_at_N callable, [N] the field's deviation at a position in the workspace
  /// frame.
  /// @returns false, with `wanted_W` unchanged, if no request is worth its cost.
  template <typename Deviation>
  bool plan(double time_s, const Eigen::Vector3d& position_W, const Eigen::Vector3d& origin_W,
            const ToolMotion& motion, const Deviation& deviation_at_N,
            Eigen::Vector3d& wanted_W) noexcept {
    double best_N = 0.0;
    for (const Eigen::Vector3d& near_W : points_around(position_W, motion)) {
      const Eigen::Vector3d point_W = on_lattice(near_W, origin_W);
      if (!std::isfinite(near_W.x()) || asked_lately(time_s, point_W)) {
        continue;
      }
      const double near_m2 = (point_W - position_W).squaredNorm();
      const double deviation_N = deviation_at_N(point_W);
      const double value_N = deviation_N * std::exp(-0.5 * near_m2 / (kReach_m * kReach_m));
      if (deviation_N > kAsk_N && value_N > best_N) {
        best_N = value_N;
        wanted_W = point_W;
      }
    }
    if (best_N <= 0.0) {
      return false;
    }
    note_asked(time_s, wanted_W);
    return true;
  }

  /// Before contact. @param deviation_at_N as plan()'s, for a tool that has touched at `origin_W`,
  /// where the surface's normal is z.
  template <typename Deviation>
  bool plan_before_contact(double time_s, const Eigen::Vector3d& origin_W,
                           const Deviation& deviation_at_N, Eigen::Vector3d& wanted_W) noexcept {
    for (const auto& displacement_m : kBeforeContact_m) {
      const Eigen::Vector3d d(displacement_m);
      const Eigen::Vector3d point_W = origin_W + d;
      if (!asked_lately(time_s, point_W) && deviation_at_N(d) > kAskBefore_N) {
        wanted_W = point_W;
        note_asked(time_s, wanted_W);
        return true;
      }
    }
    return false;
  }

 private:
  static constexpr std::size_t kAsked = 16;
  static constexpr std::size_t kPoints = 4;
  static constexpr double kBeforeContact_m[][3] = {
      {0.0, 0.0, 0.004},      {0.0, 0.0, 0.012},       {0.005, 0.0, 0.006},
      {-0.005, 0.0, 0.006},   {0.0, 0.005, 0.006},     {0.0, -0.005, 0.006},
      {0.0, 0.0, 0.018},      {0.005, 0.005, 0.012},   {-0.005, 0.005, 0.012},
      {0.005, -0.005, 0.012}, {-0.005, -0.005, 0.012}, {0.0, 0.0, 0.008},
      {0.0, 0.0, -0.004}};

  struct Asked {
    double time_s = -1e300;
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  };

  /// NaN means no point: a tool at rest has none ahead.
  std::array<Eigen::Vector3d, kPoints> points_around(const Eigen::Vector3d& position_W,
                                                     const ToolMotion& motion) noexcept;
  Eigen::Vector3d on_lattice(const Eigen::Vector3d& point_W,
                             const Eigen::Vector3d& origin_W) const noexcept;
  bool asked_lately(double time_s, const Eigen::Vector3d& point_W) const noexcept;
  void note_asked(double time_s, const Eigen::Vector3d& wanted_W) noexcept;

  std::array<Asked, kAsked> asked_{};
  std::size_t next_asked_ = 0;
  std::size_t next_beside_ = 0;
  Eigen::Vector3d lattice_corner_m_ = Eigen::Vector3d::Zero();
  double lattice_spacing_m_ = 0.0;  ///< 0: requests ask anywhere
};

}  // namespace forcegrid::kriging
