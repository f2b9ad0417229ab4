// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "calibration/held_arm.h"
#include "calibration/rigid_body.h"

namespace forcegrid::calibration {

/// The error of a joint's counter, as shown by its hard stops.
struct JointRange {
  double low_rad = 0.0;  ///< where it met them, by the uncorrected counter, at no torque
  double high_rad = 0.0;
  double width_error_rad = 0.0;      ///< of the range, by the profile's stops
  double offset_counts = 0.0;        ///< by how much the counter is too large, by both stops
  double offset_error_counts = 0.0;  ///< standard error
  bool mirrored = false;             ///< the stops would fit if the joint counted the other way
};

/// [rad] If stops differ from the profile's by more than this, it is the wrong profile.
inline constexpr double kStopTolerance_rad = 0.06;

/// Measurements of a joint pressed against its stops.
struct StopPresses {
  struct Stop {
    double profile_rad = 0.0;
    double outward = 1.0;
    std::vector<Trace> presses;  ///< one per torque, the joint at rest
  };
  int joint = 0;
  std::array<Stop, 2> stops;  ///< lower, upper
};

/// [rad] The joints of an arm with one of them at its lower or upper stop.
Eigen::Vector3d stop_pose_rad(const profiles::DeviceProfile& profile,
                              const Eigen::Vector3d& center_rad, int joint, bool upper);

/// Moves a joint of an arm to both of its hard stops and presses against each with several torques.
/// The other joints wait where the stop between the links is not in the way.
/// @param center_rad  where the arm begins and ends.
/// @throws as HeldArm::step(), and CalibrationError if there is no stop.
StopPresses press_against_stops(HeldArm& arm, const profiles::DeviceProfile& profile,
                                RigidBody& body, const Eigen::Vector3d& center_rad, int joint);

/// [s] How long press_against_stops() is likely to take, if no motor has to cool.
double stops_s(const HeldArm& arm, const profiles::DeviceProfile& profile,
               const Eigen::Vector3d& center_rad, int joint);

/// Evaluates the presses by least squares of
///
///   q - q_stop = d + b (tau - a tau_hold(q))
///
/// with d the counter's error, b the stop's compliance and a the `scale` of JointFit. So neither
/// weight nor a wrong torque constant shifts d. Friction does not either, since the joint rests; if
/// it sticks, pressing more and then less cancels that. Without `scale`, a is fitted too; this is
/// as exact if the joint's weight differs much between its stops, or is zero.
/// Real-time: no. Threads: any, with a RigidBody of its own.
JointRange judge_range(const StopPresses& presses, const profiles::DeviceProfile& profile,
                       RigidBody body, std::optional<double> scale = std::nullopt);

}  // namespace forcegrid::calibration
