// SPDX-License-Identifier: Apache-2.0
#include "driver/linkage_lines.h"

#include <cmath>

namespace forcegrid::driver {
namespace {

std::vector<LinkageLine> lines_of_arm(const profiles::DeviceProfile::Kinematics& arm,
                                      const ArmPose& pose) {
  const Eigen::Array3d theta =
      array_of(arm.linkage_offset_rad) + array_of(arm.linkage_sign) * pose.joint_angle_rad.array();
  const auto out_m = [&](double radius_m, double height_m) {
    return Eigen::Vector3d(radius_m * std::cos(theta[0]), radius_m * std::sin(theta[0]), height_m);
  };
  const Eigen::Vector3d origin = array_of(arm.origin_m);
  const Eigen::Vector3d shoulder = out_m(0.0, arm.link_length_m[0]);
  const double length_b_m = arm.link_length_m[1];
  const Eigen::Vector3d elbow =
      shoulder + out_m(length_b_m * std::sin(theta[1]), length_b_m * std::cos(theta[1]));
  std::vector<LinkageLine> lines = {{-origin, shoulder - origin, elbow - origin, pose.position_D}};
  if (pose.has_orientation) {
    lines.push_back({pose.position_D + kStylus_m * pose.rotation_DT.col(0), pose.position_D});
    lines.push_back({pose.position_D + kPointer_m * pose.rotation_DT.col(2), pose.position_D});
  }
  return lines;
}

// D's axes are the base frame's in another order, from the profile's centre.
std::vector<LinkageLine> lines_of_delta(const profiles::DeviceProfile::Delta& delta,
                                        const ArmPose& pose) {
  const Eigen::Vector3d center_B = array_of(delta.center_m);
  std::vector<LinkageLine> lines;
  for (Eigen::Index leg = 0; leg < 3; ++leg) {
    const double azimuth_rad = delta.leg_azimuth_rad[static_cast<std::size_t>(leg)];
    const double theta_rad = pose.joint_angle_rad[leg];
    const Eigen::Vector3d u_B(std::cos(azimuth_rad), std::sin(azimuth_rad), 0.0);
    const Eigen::Vector3d v_B(-std::sin(azimuth_rad), std::cos(azimuth_rad), 0.0);
    const auto in_D = [&](const Eigen::Vector3d& point_B) -> Eigen::Vector3d {
      const Eigen::Vector3d from_center_B = point_B - center_B;
      return {from_center_B.z(), from_center_B.x(), from_center_B.y()};
    };
    const Eigen::Vector3d tip_B =
        Eigen::Vector3d(pose.position_D.y(), pose.position_D.z(), pose.position_D.x()) + center_B;
    const Eigen::Vector3d hip_B = delta.base_offset_u_m * u_B + delta.base_offset_v_m * v_B;
    const Eigen::Vector3d knee_B =
        hip_B + delta.thigh_m *
                    (std::cos(theta_rad) * u_B + std::sin(theta_rad) * Eigen::Vector3d::UnitZ());
    const Eigen::Vector3d platform_B =
        tip_B + delta.platform_offset_u_m * u_B + delta.platform_offset_v_m * v_B;
    lines.push_back({in_D(hip_B), in_D(knee_B), in_D(platform_B), pose.position_D});
  }
  return lines;
}

}  // namespace

std::vector<LinkageLine> linkage_lines(const profiles::DeviceProfile& profile,
                                       const ArmPose& pose) {
  if (pose.status == KinematicsStatus::kNotFinite ||
      pose.status == KinematicsStatus::kUnreachable) {
    return {};
  }
  return profiles::is_delta(profile) ? lines_of_delta(profile.delta, pose)
                                     : lines_of_arm(profile.kinematics, pose);
}

}  // namespace forcegrid::driver
