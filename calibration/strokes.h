// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "calibration/held_arm.h"

namespace forcegrid::calibration {

/// The motions by which to identify a joint: strokes at constant speed both ways, at several
/// speeds, which separate friction from weight, and a swing, which shows inertia. Exciting each
/// parameter separately keeps the least squares well conditioned.
/// Source: Swevers, Ganseman, Tuekel, de Schutter, Van Brussel, IEEE Trans. Robotics and Automation
/// 13(5), 1997, on excitation; Khalil and Dombre (2002), ch. 12.
struct StrokePlan {
  double amplitude_rad = 0.3;  ///< to either side
  double fastest_rad_per_s = 1.0;
  double swing_rad = 0.12;
  double swing_Hz = 1.5;
  bool quick = false;  ///< fewer strokes, for a first result
};

/// Moves `joint` about `center_rad`, where the arm is, and back to it; the other joints hold.
/// @throws as HeldArm::step().
void make_strokes(HeldArm& arm, const Eigen::Vector3d& center_rad, int joint,
                  const StrokePlan& plan);

/// [s] How long make_strokes() takes.
double strokes_s(const StrokePlan& plan);

}  // namespace forcegrid::calibration
