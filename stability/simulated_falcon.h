// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "device_emulator/delta_model.h"
#include "device_emulator/emulated_falcon.h"
#include "stability/simulated_device.h"

namespace forcegrid::stability {

/// A Falcon that has been homed, without its serial line.
class SimulatedFalcon final : public SimulatedDevice {
 public:
  SimulatedFalcon(const profiles::DeviceProfile& profile, emulator::HandKind hand,
                  emulator::MotionKind motion, std::uint64_t seed, rt::TimePoint start)
      : SimulatedFalcon(options(profile, hand, motion, seed), start) {}

  Eigen::Vector3d position_D() const override { return delta_.position_D(); }
  double motor_work_J() const override { return delta_.work().motor_positive_J; }

 private:
  SimulatedFalcon(const emulator::DeviceOptions& options, rt::TimePoint start)
      : SimulatedDevice(options.operator_script, home_D(), start),
        profile_(options.profile.delta),
        delta_(options.profile, options.hand_profile(), home_D(), options.hand_carries_weight) {}

  static Eigen::Vector3d home_D() { return {0.0, 0.0, emulator::EmulatedFalcon::kStartHeight_m}; }

  Eigen::Vector3d counts_now() const override {
    return (delta_.joint_angle_rad().array() - profile_.zero_angle_rad) /
           profile_.encoder_rad_per_count;
  }
  void obey(const driver::MotorCommand& command) noexcept override {
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<Eigen::Index>(i);
      torque_Nm_[axis] = command.joint_torque_Nm[i] * motor_sign[axis];
    }
  }
  void advance(double duration_s, const Eigen::Vector3d& hand_target_D) override {
    delta_.advance(duration_s, torque_Nm_, hand_target_D);
  }

  profiles::DeviceProfile::Delta profile_;
  emulator::DeltaModel delta_;
  Eigen::Vector3d torque_Nm_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::stability
