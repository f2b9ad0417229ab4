// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "device_emulator/arm_model.h"
#include "driver/kinematics.h"
#include "stability/simulated_device.h"

namespace forcegrid::stability {

/// An arm of the WoodenHaptics family or the PHANTOM class.
class SimulatedArm final : public SimulatedDevice {
 public:
  SimulatedArm(const profiles::DeviceProfile& profile, emulator::HandKind hand,
               emulator::MotionKind motion, std::uint64_t seed, rt::TimePoint start)
      : SimulatedArm(options(profile, hand, motion, seed), start) {}

  const emulator::ArmModel& arm() const { return arm_; }
  Eigen::Vector3d position_D() const override { return arm_.position_D(); }
  double motor_work_J() const override { return arm_.work().motor_positive_J; }

 private:
  SimulatedArm(const emulator::DeviceOptions& options, rt::TimePoint start)
      : SimulatedDevice(options.operator_script,
                        emulator::ArmKinematics(options.profile.kinematics)
                            .position_D(pose_angles(options.profile)),
                        start),
        kinematics_(options.profile),
        arm_(options.profile, options.hand_profile(), pose_angles(options.profile),
             options.hand_carries_weight) {}

  static Eigen::Vector3d pose_angles(const profiles::DeviceProfile& profile) {
    const auto& counts = profile.calibration.pose_counts;
    return emulator::ArmKinematics(profile.kinematics)
        .joint_angle_rad({static_cast<double>(counts[0]), static_cast<double>(counts[1]),
                          static_cast<double>(counts[2])});
  }

  Eigen::Vector3d counts_now() const override {
    return arm_.kinematics().counts(arm_.joint_angle_rad());
  }
  void obey(const driver::MotorCommand& command) noexcept override {
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<Eigen::Index>(i);
      current_A_[axis] = command.current_A[i] * motor_sign[axis];
    }
  }
  void advance(double duration_s, const Eigen::Vector3d& hand_target_D) override {
    arm_.advance(duration_s, kinematics_.joint_torque_of_current(current_A_), hand_target_D);
  }

  driver::ArmKinematics kinematics_;
  emulator::ArmModel arm_;
  Eigen::Vector3d current_A_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::stability
