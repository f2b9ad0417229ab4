// SPDX-License-Identifier: Apache-2.0
#include "calibration/stroke_center.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calibration/motor_units.h"
#include "calibration/rig.h"
#include "calibration/rigid_body.h"
#include "driver/delta_kinematics.h"
#include "driver/mechanism.h"

namespace forcegrid::calibration {
namespace {

using Eigen::Vector3d;

constexpr double kAmplitude_rad = 0.35;
constexpr double kDeltaAmplitude_rad = 0.25;
constexpr double kStopMargin_rad = 0.15;
constexpr double kLeastAmplitude_rad = 0.25;
constexpr double kSearchStep_rad = 0.05;
constexpr double kLeastReach = 0.6;  // distance from the base axis, relative to that in mid-frame

double theta_rad(const profiles::DeviceProfile::Kinematics& kinematics, int joint,
                 double angle_rad) {
  const auto index = static_cast<std::size_t>(joint);
  return kinematics.linkage_offset_rad[index] + kinematics.linkage_sign[index] * angle_rad;
}

// The distance to the nearest stop of an arm's joint, its own or that between the links.
double room_rad(const profiles::DeviceProfile::Kinematics& kinematics, const Vector3d& angle_rad,
                int joint) {
  const auto index = static_cast<std::size_t>(joint);
  const double own_rad = std::min(angle_rad[joint] - kinematics.joint_min_rad[index],
                                  kinematics.joint_max_rad[index] - angle_rad[joint]);
  if (joint == 0) {
    return own_rad;
  }
  const double elbow_rad =
      theta_rad(kinematics, 1, angle_rad[1]) + theta_rad(kinematics, 2, angle_rad[2]);
  return std::min(
      {own_rad, elbow_rad - kinematics.elbow_min_rad, kinematics.elbow_max_rad - elbow_rad});
}

}  // namespace

driver::ArmPose pose_at(const profiles::DeviceProfile& profile, const Vector3d& angle_rad) {
  if (!is_delta(profile)) {
    return driver::ArmKinematics(profile).forward_from_angles(angle_rad);
  }
  const Vector3d counts = driver::DeltaKinematics(profile.delta).counts_of_angles(angle_rad);
  return driver::make_mechanism(profile)->forward(
      {static_cast<std::int32_t>(std::lround(counts[0])),
       static_cast<std::int32_t>(std::lround(counts[1])),
       static_cast<std::int32_t>(std::lround(counts[2])), 0, 0, 0});
}

double stroke_amplitude_rad(const profiles::DeviceProfile& profile, const Vector3d& center_rad,
                            int joint) {
  return is_delta(profile)
             ? kDeltaAmplitude_rad
             : std::min(kAmplitude_rad,
                        room_rad(profile.kinematics, center_rad, joint) - kStopMargin_rad);
}

Vector3d stroke_center_rad(const profiles::DeviceProfile& profile, double known_mass_kg) {
  if (is_delta(profile)) {
    const auto middle =
        driver::DeltaKinematics(profile.delta).inverse(Vector3d(profile.delta.center_m.data()));
    if (middle.status != driver::KinematicsStatus::kOk) {
      throw CalibrationError("profile '" + profile.name + "': delta.center_m is " +
                             to_string(middle.status) + "; correct it");
    }
    return middle.joint_angle_rad;
  }
  const auto& kinematics = profile.kinematics;
  const RigidBody body(profile, known_mass_kg);
  const MotorUnits units(profile);
  const double least_reach_m = kLeastReach * kinematics.origin_m[0];
  double least_load = std::numeric_limits<double>::infinity();
  Vector3d best_rad = Vector3d::Zero();
  Vector3d angle_rad(std::clamp(0.0, kinematics.joint_min_rad[0], kinematics.joint_max_rad[0]), 0.0,
                     0.0);
  for (angle_rad[1] = kinematics.joint_min_rad[1]; angle_rad[1] < kinematics.joint_max_rad[1];
       angle_rad[1] += kSearchStep_rad) {
    for (angle_rad[2] = kinematics.joint_min_rad[2]; angle_rad[2] < kinematics.joint_max_rad[2];
         angle_rad[2] += kSearchStep_rad) {
      const driver::ArmPose pose = pose_at(profile, angle_rad);
      const double reach_m = pose.jacobian_D.col(0).norm();
      if (reach_m < least_reach_m ||
          stroke_amplitude_rad(profile, angle_rad, 1) < kLeastAmplitude_rad ||
          stroke_amplitude_rad(profile, angle_rad, 2) < kLeastAmplitude_rad) {
        continue;
      }
      const Vector3d current_A = units.current_A(body.holding_Nm(pose));
      double load = 0.0;
      for (int joint = 0; joint < 3; ++joint) {
        load = std::max(load,
                        std::abs(current_A[joint]) /
                            profile.motors.continuous_current_A[static_cast<std::size_t>(joint)]);
      }
      // Among poses of equal weight, as of a balanced arm, takes the one that reaches furthest.
      load -= 1e-3 * reach_m;
      if (load < least_load) {
        least_load = load;
        best_rad = angle_rad;
      }
    }
  }
  if (!std::isfinite(least_load)) {
    throw CalibrationError("profile '" + profile.name +
                           "': its hard stops leave no room to move the joints; correct "
                           "kinematics.joint_min_rad, joint_max_rad and elbow_min_rad");
  }
  return best_rad;
}

}  // namespace forcegrid::calibration
