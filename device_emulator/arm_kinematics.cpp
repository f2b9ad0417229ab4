// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/arm_kinematics.h"

#include <cmath>
#include <numbers>

#include "rt/vectors.h"

namespace forcegrid::emulator {

namespace {}  // namespace

ArmKinematics::ArmKinematics(const profiles::DeviceProfile::Kinematics& kinematics) noexcept
    : link_length_m_(rt::to_vector(kinematics.link_length_m)),
      origin_D_(rt::to_vector(kinematics.origin_m)),
      joint_rad_per_count_(2.0 * std::numbers::pi *
                           (rt::to_vector(kinematics.encoder_sign).array() *
                            rt::to_vector(kinematics.capstan_diameter_m).array() /
                            rt::to_vector(kinematics.body_diameter_m).array() /
                            rt::to_vector(kinematics.encoder_counts_per_turn).array())
                               .matrix()),
      linkage_sign_(rt::to_vector(kinematics.linkage_sign)),
      linkage_offset_rad_(rt::to_vector(kinematics.linkage_offset_rad)) {}

Eigen::Vector3d ArmKinematics::joint_angle_rad(const Eigen::Vector3d& counts) const noexcept {
  return counts.cwiseProduct(joint_rad_per_count_);
}

Eigen::Vector3d ArmKinematics::counts(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return joint_angle_rad.cwiseQuotient(joint_rad_per_count_);
}

Eigen::Vector3d ArmKinematics::position_D(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return motion(joint_angle_rad, Eigen::Vector3d::Zero()).position_D;
}

ArmKinematics::Motion ArmKinematics::motion(
    const Eigen::Vector3d& joint_angle_rad,
    const Eigen::Vector3d& joint_speed_rad_per_s) const noexcept {
  const Eigen::Vector3d theta = linkage_offset_rad_ + linkage_sign_.cwiseProduct(joint_angle_rad);
  const Eigen::Vector3d theta_speed = linkage_sign_.cwiseProduct(joint_speed_rad_per_s);
  const double length_b = link_length_m_[1];
  const double length_c = link_length_m_[2];
  const double sin_a = std::sin(theta[0]);
  const double cos_a = std::cos(theta[0]);
  const double sin_b = std::sin(theta[1]);
  const double cos_b = std::cos(theta[1]);
  const double sin_c = std::sin(theta[2]);
  const double cos_c = std::cos(theta[2]);
  const double radius = length_b * sin_b + length_c * sin_c;

  Motion result;
  result.linkage_angle_rad = theta;
  result.position_D = Eigen::Vector3d(radius * cos_a, radius * sin_a,
                                      link_length_m_[0] + length_b * cos_b - length_c * cos_c) -
                      origin_D_;

  // Columns: derivatives by theta_a, theta_b, theta_c; then by q through the linkage's signs.
  result.jacobian_m_per_rad.col(0) =
      linkage_sign_[0] * Eigen::Vector3d(-radius * sin_a, radius * cos_a, 0.0);
  result.jacobian_m_per_rad.col(1) =
      linkage_sign_[1] *
      Eigen::Vector3d(length_b * cos_b * cos_a, length_b * cos_b * sin_a, -length_b * sin_b);
  result.jacobian_m_per_rad.col(2) =
      linkage_sign_[2] *
      Eigen::Vector3d(length_c * cos_c * cos_a, length_c * cos_c * sin_a, length_c * sin_c);

  // Second time derivative of (r cos a, r sin a, h) with theta'' = 0.
  const double radius_speed = length_b * cos_b * theta_speed[1] + length_c * cos_c * theta_speed[2];
  const double radius_bias = -length_b * sin_b * theta_speed[1] * theta_speed[1] -
                             length_c * sin_c * theta_speed[2] * theta_speed[2];
  const double height_bias = -length_b * cos_b * theta_speed[1] * theta_speed[1] +
                             length_c * cos_c * theta_speed[2] * theta_speed[2];
  const double centripetal = radius_bias - radius * theta_speed[0] * theta_speed[0];
  const double coriolis = 2.0 * radius_speed * theta_speed[0];
  result.bias_m_per_s2 = {centripetal * cos_a - coriolis * sin_a,
                          centripetal * sin_a + coriolis * cos_a, height_bias};
  return result;
}

double ArmKinematics::elbow_rad(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return linkage_offset_rad_[1] + linkage_sign_[1] * joint_angle_rad[1] + linkage_offset_rad_[2] +
         linkage_sign_[2] * joint_angle_rad[2];
}

}  // namespace forcegrid::emulator
