// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "driver/device.h"
#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::servo {

/// Finds motors that push the wrong way, or not at all, before a force is rendered.
///
/// A rendered force does not show the sign: a hand that moves slowly through an object balances
/// either force, and looks the same to the encoders. A known push does. Each joint in turn gets
/// four short pushes, + - - +, of about 1.5 N at the tip; then each joint of a wrist with motors,
/// of kWristPush of its largest torque. A push that begins at t and lasts T changes the joint's
/// course by
///
///   D = (q(t + T) - q(t)) - (q(t) - q(t - T)),
///
/// half of M^-1 tau T^2 for a mass, K^-1 tau for a spring, B^-1 tau T for a damper. For anything
/// passive that hangs on the joint, hands included, D has the sign of the torque. In the sum with
/// the signs of the pushes, motion of the hand at constant speed, acceleration or jerk cancels.
///
/// A joint passes when the sum is positive, and fails when the sum is negative twice. A joint that
/// does not answer within kAttempts, each harder than the last, has no power or no encoder, or is
/// held fast.
///
/// Two motors or two encoders at each other's plug can pass this: on a coupled arm, a push of one
/// joint moves the other as well. The answers of all joints to all pushes, the matrix A, reveal
/// them. For anything passive, A is symmetric and positive definite, so A_ij A_ji < A_ii A_jj; an
/// exchange of i and j reverses that. If it is reversed, all joints are pushed once more; if it is
/// reversed again, joint j fails as one that pushes the wrong way.
///
/// The wrist's motors are checked after the arm's and in the same way. Their pushes bypass
/// driver::WristLimiter, so they stay within each joint's largest torque and current here.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class MotorCheck {
 public:
  enum class Verdict : std::uint8_t { kRunning, kPassed, kWrongWay, kNoAnswer };
  enum class Motors : std::uint8_t {
    kAll,  ///< the arm's, and a wrist's if it has any
    kArm,
  };

  static constexpr double kPush_N = 1.5;
  /// Of gimbal_motors.max_torque_Nm. Engineering choice: the emulated hand turns by 0.035 rad, and
  /// the last attempt, kHarder^2 of it, stays below the largest torque.
  static constexpr double kWristPush = 0.25;
  static constexpr rt::Duration kPushTime = std::chrono::milliseconds(16);
  static constexpr int kLeastPushCycles = 3;
  static constexpr int kRestPushes = 2;  ///< pause after each push, in pushes
  static constexpr int kAttempts = 3;
  static constexpr double kHarder = 1.5;              ///< from attempt to attempt
  static constexpr double kLeastAnswer_counts = 8.0;  ///< of the four pushes together
  /// A_ij A_ji over A_ii A_jj above which i and j count as exchanged. The value 1 divides the two
  /// cases; the rest is for the noise of a hand.
  static constexpr double kCrossed = 1.2;

  /// @param period  of the cycles. @param motors  kArm leaves a wrist's motors without current.
  MotorCheck(const profiles::DeviceProfile& profile, rt::Duration period,
             Motors motors = Motors::kAll) noexcept;

  /// One cycle. @param report the newest one. @param pose its pose.
  Verdict update(rt::TimePoint now, const driver::DeviceReport& report,
                 const driver::ArmPose& pose) noexcept;

  /// [Nm] of joints a, b, c to command in this cycle; zero unless kRunning.
  [[nodiscard]] Eigen::Vector3d joint_torque_Nm() const noexcept { return torque_Nm_.head<3>(); }
  /// [A] of the motors of the wrist's joints 1, 2, 3, likewise; zero without such motors.
  [[nodiscard]] std::array<double, 3> wrist_current_A() const noexcept;

  /// The joint that is being checked, or that has failed: 0, 1, 2 for a, b, c; 3, 4, 5 for the
  /// joint of a wrist that counter d, e, f measures.
  [[nodiscard]] int joint() const noexcept;

  /// The loop has paused: discards the push in progress and checks the joint from its start.
  void restart() noexcept;

 private:
  /// Joints a, b, c, then the wrist's from the arm outward.
  using Joints = Eigen::Matrix<double, 6, 1>;
  using JointMatrix = Eigen::Matrix<double, 6, 6>;
  static constexpr int kArmJoints = 3;

  struct Course {
    double time_s = 0.0;
    Joints angle_rad = Joints::Zero();
    Joints counts = Joints::Zero();
  };

  void begin_attempt() noexcept;
  [[nodiscard]] Course course(rt::TimePoint now, const driver::DeviceReport& report,
                              const driver::ArmPose& pose) const noexcept;
  /// [Nm] with which this attempt pushes the joint.
  [[nodiscard]] double push_Nm(const driver::ArmPose& pose) const noexcept;
  Verdict judge() noexcept;
  Verdict judge_all() noexcept;
  [[nodiscard]] int crossed_joint() const noexcept;

  profiles::Axes friction_Nm_;
  int push_cycles_;
  int joints_ = kArmJoints;              ///< that are checked
  std::array<int, 3> counter_{3, 4, 5};  ///< of the wrist's joints
  double wrist_push_Nm_ = 0.0;           ///< of the first attempt
  profiles::Axes wrist_most_Nm_{};       ///< what torque and current of each joint allow
  profiles::Axes wrist_A_per_Nm_{};      ///< signed
  int joint_ = 0;
  int attempt_ = 0;
  int negative_ = 0;
  int push_ = 0;
  int cycle_ = 0;  ///< since the rest before the push began
  Course before_;
  Course begin_;
  Joints answer_rad_ = Joints::Zero();  ///< of every joint
  Joints answer_counts_ = Joints::Zero();
  JointMatrix answers_rad_ = JointMatrix::Zero();  ///< A: a column for each pushed joint
  JointMatrix answers_counts_ = JointMatrix::Zero();
  bool crossed_before_ = false;
  Verdict verdict_ = Verdict::kRunning;
  Joints torque_Nm_ = Joints::Zero();
};

}  // namespace forcegrid::servo
