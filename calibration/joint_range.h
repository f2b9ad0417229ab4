// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "calibration/held_arm.h"
#include "calibration/rigid_body.h"

namespace forcegrid::calibration {

/// What a joint's hard stops say of its counter.
struct JointRange {
  double low_rad = 0.0;  ///< where it met them, by the counter as it was, at no torque
  double high_rad = 0.0;
  double width_error_rad = 0.0;      ///< of the range, by the profile's stops
  double offset_counts = 0.0;        ///< the counter is so much too large, by both stops
  double offset_error_counts = 0.0;  ///< standard error
  bool mirrored = false;             ///< the stops would fit if the joint counted the other way
};

/// [rad] Stops that differ by more than this from the profile's are not that profile's.
inline constexpr double kStopTolerance_rad = 0.06;

/// What happened while a joint was pressed against its stops.
struct StopPresses {
  struct Stop {
    double profile_rad = 0.0;
    double outward = 1.0;
    std::vector<Trace> presses;  ///< one a torque, the joint at rest
  };
  int joint = 0;
  std::array<Stop, 2> stops;  ///< lower, upper
};

/// [rad] The joints of an arm with one of them at its lower or upper stop.
Eigen::Vector3d stop_pose_rad(const profiles::DeviceProfile& profile,
                              const Eigen::Vector3d& center_rad, int joint, bool upper);

/// Moves a joint of an arm to both of its hard stops, the others parked where the stop between the
/// links is not in the way, and presses against each with several torques.
/// @param center_rad  where the arm begins and ends.
/// @throws as HeldArm::step(), and CalibrationError where there is no stop.
StopPresses press_against_stops(HeldArm& arm, const profiles::DeviceProfile& profile,
                                RigidBody& body, const Eigen::Vector3d& center_rad, int joint);

/// What the presses say, by least squares of
///
///   q - q_stop = d + b (tau - a tau_hold(q))
///
/// with d the counter's error, b the stop's compliance and a the `scale` of JointFit. Weight and a
/// wrong torque constant thus do not shift d, nor does friction, since the joint rests; where it
/// sticks, pressing more and then less cancels that. Without `scale`, a is found, too, which is as
/// exact where the joint's weight differs much between its stops, or is none.
/// Real-time: no. Threads: any, with a RigidBody of its own.
JointRange judge_range(const StopPresses& presses, const profiles::DeviceProfile& profile,
                       RigidBody body, std::optional<double> scale = std::nullopt);

}  // namespace forcegrid::calibration
