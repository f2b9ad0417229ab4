// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>

#include "calibration/rig.h"
#include "device_emulator/arm_model.h"
#include "device_emulator/delta_model.h"
#include "profiles/device_profile.h"

namespace forcegrid::calibration {

/// The emulator's arm or delta in simulated time, without USB: motors, encoders and physics by the
/// true profile, whatever the calibration believes.
class SimulatedRig final : public Rig {
 public:
  struct Options {
    double known_mass_kg = 0.0;
    Eigen::Vector3d motor_sign = Eigen::Vector3d::Ones();  ///< -1: leads swapped
    std::array<std::int32_t, 3> counter_error{};           ///< counts too many
    double hand_lets_go_at_s = -1.0;                       ///< a hand holds it until then
    double stop_at_s = 1e9;                                ///< as Ctrl-C
    double pause_every_s = 1e9;                            ///< as of a host that is shared
    double pause_s = 0.0;
  };

  SimulatedRig(const profiles::DeviceProfile& reference, const Options& options)
      : reference_(reference), options_(options) {
    next_pause_s_ = options.pause_every_s;
    const bool held = options.hand_lets_go_at_s >= 0.0;
    const auto hand = held ? std::optional(reference.firm_hand) : std::nullopt;
    if (reference.kind == profiles::DeviceKind::kDelta) {
      delta_.emplace(reference, hand, Eigen::Vector3d::Zero());
      delta_->attach_tip_mass(options.known_mass_kg);
    } else {
      const emulator::ArmKinematics kinematics(reference.kinematics);
      const auto& pose = reference.calibration.pose_counts;
      arm_.emplace(reference, hand,
                   kinematics.joint_angle_rad({1.0 * pose[0], 1.0 * pose[1], 1.0 * pose[2]}));
      arm_->attach_tip_mass(options.known_mass_kg);
    }
    hand_target_D_ = arm_ ? arm_->position_D() : delta_->position_D();
  }

  driver::DeviceReport step(const driver::MotorCommand& command) override {
    if (time_s_ > options_.stop_at_s) {
      last_command_ = {};
      throw Stopped();
    }
    if (options_.hand_lets_go_at_s >= 0.0 && time_s_ >= options_.hand_lets_go_at_s && !let_go_) {
      let_go_ = true;
      arm_ ? arm_->release_hand() : delta_->release_hand();
    }
    last_command_ = command;
    hand_target_D_ += kPeriod_s * hand_velocity_D_m_per_s;
    const Eigen::Vector3d torque_Nm = motor_torque_Nm(command).cwiseProduct(options_.motor_sign);
    largest_torque_Nm = largest_torque_Nm.cwiseMax(torque_Nm.cwiseAbs());
    double end_s = time_s_ + kPeriod_s;
    if (end_s > next_pause_s_) {
      end_s += options_.pause_s;
      next_pause_s_ = end_s + options_.pause_every_s;
    }
    while (time_s_ < end_s - 0.5 * kPeriod_s) {
      arm_ ? arm_->advance(kPeriod_s, torque_Nm, hand_target_D_)
           : delta_->advance(kPeriod_s, torque_Nm, hand_target_D_);
      time_s_ += kPeriod_s;
    }
    driver::DeviceReport report;
    report.sequence = ++sequence_;
    const Eigen::Vector3d counts = counts_now();
    for (std::size_t i = 0; i < 3; ++i) {
      report.counts[i] =
          static_cast<std::int32_t>(std::llround(counts[static_cast<Eigen::Index>(i)])) +
          options_.counter_error[i];
    }
    report.released = report.received = rt::TimePoint(rt::from_seconds(time_s_));
    return report;
  }

  [[nodiscard]] rt::Duration period() const noexcept override {
    return rt::from_seconds(kPeriod_s);
  }
  [[nodiscard]] double time_s() const noexcept { return time_s_; }
  [[nodiscard]] bool motors_on() const noexcept {
    for (std::size_t i = 0; i < 3; ++i) {
      if (last_command_.current_A[i] != 0.0 || last_command_.joint_torque_Nm[i] != 0.0) {
        return true;
      }
    }
    return false;
  }

  Eigen::Vector3d hand_velocity_D_m_per_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d largest_torque_Nm = Eigen::Vector3d::Zero();

 private:
  static constexpr double kPeriod_s = 0.002;

  // As the device's electronics make it: the report's whole milliamperes, or whole commands.
  Eigen::Vector3d motor_torque_Nm(const driver::MotorCommand& command) const {
    Eigen::Vector3d torque_Nm;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<Eigen::Index>(i);
      if (delta_) {
        // The host converts with the gain that it believes; see believed_gain_per_Nm.
        torque_Nm[axis] = std::trunc(command.joint_torque_Nm[i] * believed_gain_per_Nm) /
                          reference_.falcon.torque_gain_per_Nm;
      } else {
        const auto& kinematics = reference_.kinematics;
        torque_Nm[axis] = 1e-3 * std::trunc(1e3 * command.current_A[i]) *
                          kinematics.encoder_sign[i] *
                          reference_.motors.torque_constant_Nm_per_A[i] *
                          kinematics.body_diameter_m[i] / kinematics.capstan_diameter_m[i];
      }
    }
    return torque_Nm;
  }

  Eigen::Vector3d counts_now() const {
    if (arm_) {
      return arm_->kinematics().counts(arm_->joint_angle_rad());
    }
    return (delta_->joint_angle_rad().array() - reference_.delta.zero_angle_rad) /
           reference_.delta.encoder_rad_per_count;
  }

 public:
  double believed_gain_per_Nm = 1.0;  ///< of a delta's host

 private:
  profiles::DeviceProfile reference_;
  Options options_;
  std::optional<emulator::ArmModel> arm_;
  std::optional<emulator::DeltaModel> delta_;
  Eigen::Vector3d hand_target_D_;
  driver::MotorCommand last_command_;
  double time_s_ = 0.0;
  double next_pause_s_ = 0.0;
  std::uint64_t sequence_ = 0;
  bool let_go_ = false;
};

}  // namespace forcegrid::calibration
