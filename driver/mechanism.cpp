// SPDX-License-Identifier: Apache-2.0
#include "driver/mechanism.h"

#include "driver/delta_kinematics.h"
#include "driver/gimbal_kinematics.h"

namespace forcegrid::driver {
namespace {

class ArmMechanism final : public Mechanism {
 public:
  explicit ArmMechanism(const profiles::DeviceProfile& profile)
      : kinematics_(profile), wrist_(profile) {}

  ArmPose forward(const std::array<std::int32_t, 6>& counts) noexcept override {
    ArmPose pose = kinematics_.forward(counts);
    wrist_.orient(counts, pose);
    return pose;
  }
  Eigen::Vector3d gravity_torque(const Eigen::Vector3d& joint_angle_rad) const noexcept override {
    return kinematics_.gravity_torque(joint_angle_rad);
  }

 private:
  ArmKinematics kinematics_;
  GimbalKinematics wrist_;
};

/// A delta in the device frame D, whose axes are the base frame's in another order: x_D = z_B,
/// y_D = x_B, z_D = y_B, from the profile's centre.
class DeltaMechanism final : public Mechanism {
 public:
  explicit DeltaMechanism(const profiles::DeviceProfile& profile)
      : kinematics_(profile.delta),
        center_B_(profile.delta.center_m[0], profile.delta.center_m[1], profile.delta.center_m[2]),
        last_position_B_(center_B_) {}

  ArmPose forward(const std::array<std::int32_t, 6>& counts) noexcept override {
    const DeltaPose delta = kinematics_.forward(
        kinematics_.angles_of_counts(Eigen::Vector3d(counts[0], counts[1], counts[2])),
        last_position_B_);
    ArmPose pose;
    pose.joint_angle_rad = delta.joint_angle_rad;
    if (delta.status == KinematicsStatus::kUnreachable) {
      // Counts that belong to no pose at all are beyond any hard stop.
      pose.status = KinematicsStatus::kOutOfRange;
      return pose;
    }
    last_position_B_ = delta.position_B;
    pose.status = delta.status;
    pose.position_D = in_D(delta.position_B - center_B_);
    for (Eigen::Index leg = 0; leg < 3; ++leg) {
      pose.jacobian_D.col(leg) = in_D(delta.jacobian_B.col(leg));
    }
    return pose;
  }

  // The masses of its moving parts are in no source.
  Eigen::Vector3d gravity_torque(const Eigen::Vector3d&) const noexcept override {
    return Eigen::Vector3d::Zero();
  }

 private:
  static Eigen::Vector3d in_D(const Eigen::Vector3d& vector_B) noexcept {
    return Eigen::Vector3d(vector_B.z(), vector_B.x(), vector_B.y());
  }

  DeltaKinematics kinematics_;
  Eigen::Vector3d center_B_;
  Eigen::Vector3d last_position_B_;
};

}  // namespace

std::unique_ptr<Mechanism> make_mechanism(const profiles::DeviceProfile& profile) {
  if (profile.kind == profiles::DeviceKind::kDelta) {
    return std::make_unique<DeltaMechanism>(profile);
  }
  return std::make_unique<ArmMechanism>(profile);
}

}  // namespace forcegrid::driver
