// SPDX-License-Identifier: Apache-2.0
#include "driver/kinematics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "driver/w2_codec.h"

namespace forcegrid::driver {
Eigen::Array3d array_of(const profiles::Axes& axes) {
  return Eigen::Array3d(axes[0], axes[1], axes[2]);
}

const char* to_string(KinematicsStatus status) noexcept {
  switch (status) {
    case KinematicsStatus::kOk:
      return "ok";
    case KinematicsStatus::kOutOfRange:
      return "beyond the hard stops";
    case KinematicsStatus::kSingular:
      return "singular";
    case KinematicsStatus::kUnreachable:
      return "unreachable";
    case KinematicsStatus::kNotFinite:
      return "not finite";
  }
  return "unknown";
}

Eigen::Array3d angle_per_count_rad(const profiles::DeviceProfile& profile) noexcept {
  if (profile.kind == profiles::DeviceKind::kDelta) {
    return Eigen::Array3d::Constant(profile.delta.encoder_rad_per_count);
  }
  const auto& arm = profile.kinematics;
  return (2.0 * std::numbers::pi * array_of(arm.capstan_diameter_m) /
          (array_of(arm.encoder_counts_per_turn) * array_of(arm.body_diameter_m)))
      .abs();
}

ArmKinematics::ArmKinematics(const profiles::DeviceProfile& profile)
    : ArmKinematics(profile.kinematics, profile.motors, profile.gravity) {}

ArmKinematics::ArmKinematics(const profiles::DeviceProfile::Kinematics& arm,
                             const profiles::DeviceProfile::Motors& motors,
                             const profiles::DeviceProfile::Gravity& gravity) noexcept
    : origin_m_(array_of(arm.origin_m)),
      max_current_A_(array_of(motors.max_current_A)),
      linkage_sign_(array_of(arm.linkage_sign)),
      linkage_offset_rad_(array_of(arm.linkage_offset_rad)),
      joint_min_rad_(array_of(arm.joint_min_rad)),
      joint_max_rad_(array_of(arm.joint_max_rad)),
      length_a_m_(arm.link_length_m[0]),
      length_b_m_(arm.link_length_m[1]),
      length_c_m_(arm.link_length_m[2]),
      elbow_min_rad_(arm.elbow_min_rad),
      elbow_max_rad_(arm.elbow_max_rad),
      weight_b_Nm_(gravity.acceleration_m_per_s2 *
                   (gravity.link_b_mass_kg * gravity.link_b_center_m +
                    gravity.link_c_mass_kg * arm.link_length_m[1])),
      weight_c_Nm_(gravity.acceleration_m_per_s2 * gravity.link_c_mass_kg *
                   gravity.link_c_center_m) {
  const Eigen::Array3d ratio = array_of(arm.capstan_diameter_m) / array_of(arm.body_diameter_m);
  const Eigen::Array3d encoder_sign = array_of(arm.encoder_sign);
  angle_per_count_rad_ =
      encoder_sign * 2.0 * std::numbers::pi * ratio / array_of(arm.encoder_counts_per_turn);
  current_per_torque_A_per_Nm_ = encoder_sign * ratio / array_of(motors.torque_constant_Nm_per_A);
}

bool ArmKinematics::within_stops(const Eigen::Vector3d& joint_angle_rad,
                                 double elbow_rad) const noexcept {
  return (joint_angle_rad.array() >= joint_min_rad_ - kStopTolerance_rad).all() &&
         (joint_angle_rad.array() <= joint_max_rad_ + kStopTolerance_rad).all() &&
         elbow_rad >= elbow_min_rad_ - kStopTolerance_rad &&
         elbow_rad <= elbow_max_rad_ + kStopTolerance_rad;
}

ArmPose ArmKinematics::forward(const Eigen::Vector3d& counts) const noexcept {
  return forward_from_angles((counts.array() * angle_per_count_rad_).matrix());
}

ArmPose ArmKinematics::forward(const std::array<std::int32_t, 6>& counts) const noexcept {
  return forward(Eigen::Vector3d(counts[0], counts[1], counts[2]));
}

ArmPose ArmKinematics::forward_from_angles(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  ArmPose pose;
  if (!joint_angle_rad.allFinite()) {
    return pose;
  }
  const Eigen::Array3d theta = linkage_offset_rad_ + linkage_sign_ * joint_angle_rad.array();
  const double sin_a = std::sin(theta[0]), cos_a = std::cos(theta[0]);
  const double sin_b = std::sin(theta[1]), cos_b = std::cos(theta[1]);
  const double sin_c = std::sin(theta[2]), cos_c = std::cos(theta[2]);
  const double radius_m = length_b_m_ * sin_b + length_c_m_ * sin_c;

  pose.joint_angle_rad = joint_angle_rad;
  pose.position_D << radius_m * cos_a - origin_m_[0], radius_m * sin_a - origin_m_[1],
      length_a_m_ + length_b_m_ * cos_b - length_c_m_ * cos_c - origin_m_[2];
  pose.jacobian_D << -radius_m * sin_a, length_b_m_ * cos_a * cos_b, length_c_m_ * cos_a * cos_c,
      radius_m * cos_a, length_b_m_ * sin_a * cos_b, length_c_m_ * sin_a * cos_c,  //
      0.0, -length_b_m_ * sin_b, length_c_m_ * sin_c;
  for (Eigen::Index joint = 0; joint < 3; ++joint) {
    pose.jacobian_D.col(joint) *= linkage_sign_[joint];
  }

  // The sine turns negative for a flipped elbow, and so does the radius behind the base axis.
  const double elbow_rad = theta[1] + theta[2];
  if (std::sin(elbow_rad) < kSingularSine || radius_m < kSingularRadius_m) {
    pose.status = KinematicsStatus::kSingular;
  } else if (!within_stops(joint_angle_rad, elbow_rad)) {
    pose.status = KinematicsStatus::kOutOfRange;
  } else {
    pose.status = KinematicsStatus::kOk;
  }
  return pose;
}

ArmInverse ArmKinematics::inverse(const Eigen::Vector3d& position_D) const noexcept {
  ArmInverse result;
  if (!position_D.allFinite()) {
    return result;
  }
  const double x_m = position_D[0] + origin_m_[0];
  const double y_m = position_D[1] + origin_m_[1];
  const double height_m = position_D[2] + origin_m_[2] - length_a_m_;
  const double radius_m = std::hypot(x_m, y_m);
  const double distance_m = std::hypot(radius_m, height_m);
  if (!(distance_m < length_b_m_ + length_c_m_) ||
      !(distance_m > std::abs(length_b_m_ - length_c_m_))) {
    result.status = KinematicsStatus::kUnreachable;
    return result;
  }
  const double b2 = length_b_m_ * length_b_m_;
  const double c2 = length_c_m_ * length_c_m_;
  const double d2 = distance_m * distance_m;
  const double cos_elbow =
      std::clamp((b2 + c2 - d2) / (2.0 * length_b_m_ * length_c_m_), -1.0, 1.0);
  const double elbow_rad = std::acos(cos_elbow);
  if (radius_m < kSingularRadius_m || std::sin(elbow_rad) < kSingularSine) {
    result.status = KinematicsStatus::kSingular;
    return result;
  }
  const double cos_shoulder =
      std::clamp((b2 + d2 - c2) / (2.0 * length_b_m_ * distance_m), -1.0, 1.0);
  Eigen::Array3d theta;
  theta[0] = std::atan2(y_m, x_m);
  theta[1] = std::atan2(radius_m, height_m) - std::acos(cos_shoulder);
  theta[2] = elbow_rad - theta[1];
  result.joint_angle_rad = ((theta - linkage_offset_rad_) * linkage_sign_).matrix();
  result.counts = counts_of_angles(result.joint_angle_rad);
  result.status = within_stops(result.joint_angle_rad, elbow_rad) ? KinematicsStatus::kOk
                                                                  : KinematicsStatus::kOutOfRange;
  return result;
}

Eigen::Vector3d ArmKinematics::joint_torque(const ArmPose& pose,
                                            const Eigen::Vector3d& force_D) noexcept {
  return pose.jacobian_D.transpose() * force_D;
}

Eigen::Vector3d ArmKinematics::gravity_torque(
    const Eigen::Vector3d& joint_angle_rad) const noexcept {
  if (!joint_angle_rad.allFinite()) {
    return Eigen::Vector3d::Zero();
  }
  const Eigen::Array3d theta = linkage_offset_rad_ + linkage_sign_ * joint_angle_rad.array();
  return Eigen::Vector3d(0.0, -linkage_sign_[1] * weight_b_Nm_ * std::sin(theta[1]),
                         linkage_sign_[2] * weight_c_Nm_ * std::sin(theta[2]));
}

double ArmKinematics::potential_energy_J(const Eigen::Vector3d& joint_angle_rad) const noexcept {
  const Eigen::Array3d theta = linkage_offset_rad_ + linkage_sign_ * joint_angle_rad.array();
  return weight_b_Nm_ * std::cos(theta[1]) - weight_c_Nm_ * std::cos(theta[2]);
}

Eigen::Vector3d ArmKinematics::motor_current_A(
    const Eigen::Vector3d& joint_torque_Nm) const noexcept {
  return (joint_torque_Nm.array() * current_per_torque_A_per_Nm_).matrix();
}

Eigen::Vector3d ArmKinematics::joint_torque_of_current(
    const Eigen::Vector3d& current_A) const noexcept {
  return (current_A.array() / current_per_torque_A_per_Nm_).matrix();
}

ReportCurrent ArmKinematics::report_current(const Eigen::Vector3d& current_A) const noexcept {
  const w2::Currents currents =
      w2::report_currents({current_A[0], current_A[1], current_A[2]},
                          {max_current_A_[0], max_current_A_[1], max_current_A_[2]});
  return {currents.finite, currents.clamped, currents.current_mA};
}

Eigen::Vector3d ArmKinematics::counts_of_angles(
    const Eigen::Vector3d& joint_angle_rad) const noexcept {
  return (joint_angle_rad.array() / angle_per_count_rad_).matrix();
}

}  // namespace forcegrid::driver
