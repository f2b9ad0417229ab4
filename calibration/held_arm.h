// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "calibration/motor_units.h"
#include "calibration/rig.h"
#include "calibration/rigid_body.h"
#include "servo_loop/motor_warmth.h"

namespace forcegrid::calibration {

/// One step of a motion: what flowed, and the counters after it.
struct TracePoint {
  double time_s = 0.0;  ///< of the counters
  std::array<std::int32_t, 6> counts{};
  /// Of the command that flowed until then, by the profile's torque constants.
  Eigen::Vector3d joint_torque_Nm = Eigen::Vector3d::Zero();
};
using Trace = std::vector<TracePoint>;

/// Where the joints shall be.
struct JointTarget {
  Eigen::Vector3d angle_rad = Eigen::Vector3d::Zero();
  Eigen::Vector3d speed_rad_per_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d acceleration_rad_per_s2 = Eigen::Vector3d::Zero();
};

/// A joint that gives a constant torque instead of holding an angle, on top of what holds it.
struct Press {
  int joint = 0;
  double torque_Nm = 0.0;
};

/// Moves the joints of a device that no hand holds, slowly and weakly, and gives up when something
/// is not as it should be.
///
///   tau = tau_hold(q) + I_j (q''_t + w^2 e + 2 w e') + k_i integral(e),   e = q_t - q
///
/// with I_j the inertia that a joint feels and w = kBandwidth_rad_per_s. Torques stay below half of
/// what the profile allows in torque and current. Motors get zero before an exception leaves.
///
/// Real-time: step() allocates only where it records or throws. Threads: one.
class HeldArm {
 public:
  static constexpr double kBandwidth_rad_per_s = 25.0;
  /// Of the profile's largest speed; motions are planned with kPlannedSpeed of it.
  static constexpr double kSpeedLimit = 0.6;
  static constexpr double kPlannedSpeed = 0.3;
  /// [rad] A joint that is further from where it should be for kAwayFor_s is not followed any more.
  static constexpr double kAway_rad = 0.3;
  static constexpr double kAwayFor_s = 0.3;
  /// [rad] Beyond the profile's stops: they give, and pose and profile may be a little wrong.
  static constexpr double kBeyondStop_rad = 0.35;
  /// Warmth, 1 being that of the continuous current: to which a pause cools, from which on there is
  /// one before the next motion, and which ends a motion.
  static constexpr double kCool = 0.42;
  static constexpr double kWarm = 0.5;
  static constexpr double kTooWarm = 0.97;

  /// @param body  outlives it. Begins with a step of zero current, from where it finds the arm.
  HeldArm(Rig& rig, const profiles::DeviceProfile& profile, RigidBody& body);

  /// @throws CalibrationError, see above; what Rig::step() throws.
  void step(const JointTarget& target, std::optional<Press> press = std::nullopt);
  /// Holds where the arm should be now.
  void hold(double time_s);
  /// Moves all joints there, smoothly, at a planned speed.
  void move_to(const Eigen::Vector3d& angle_rad);
  /// Rests at `angle_rad` until the motors are cold enough for a motion.
  void cool(const Eigen::Vector3d& angle_rad);
  /// Whether it should cool before more is asked of it.
  [[nodiscard]] bool warm() const noexcept { return warmth_.warmest() > kWarm; }
  /// Zero current.
  void release();

  /// Steps are appended to `trace` until record(nullptr); it outlives that.
  void record(Trace* trace) noexcept { trace_ = trace; }
  /// The counters were given another offset: where the arm is now is where it shall be.
  void forget_target() noexcept;

  [[nodiscard]] const driver::ArmPose& pose() const noexcept { return pose_; }
  [[nodiscard]] const Eigen::Vector3d& speed_rad_per_s() const noexcept { return speed_; }
  [[nodiscard]] const std::array<std::int32_t, 6>& counts() const noexcept { return counts_; }
  [[nodiscard]] double time_s() const noexcept { return time_s_; }
  [[nodiscard]] double period_s() const noexcept { return period_s_; }
  /// [rad/s] planned for each joint about this pose, so that the tip keeps kPlannedSpeed.
  [[nodiscard]] Eigen::Vector3d planned_speed_rad_per_s() const noexcept;
  /// [Nm] the largest that a step commands.
  [[nodiscard]] const Eigen::Vector3d& torque_limit_Nm() const noexcept { return limit_Nm_; }
  [[nodiscard]] double largest_tip_speed_m_per_s() const noexcept { return fastest_m_per_s_; }
  [[nodiscard]] const Eigen::Vector3d& largest_current_A() const noexcept { return most_A_; }

 private:
  void take(const driver::DeviceReport& report);
  void supervise(const JointTarget& target, bool limited, std::optional<Press> press);
  [[noreturn]] void give_up(const std::string& why);

  Rig& rig_;
  const profiles::DeviceProfile& profile_;
  RigidBody& body_;
  MotorUnits units_;
  servo::MotorWarmth warmth_;
  Eigen::Vector3d limit_Nm_;
  Eigen::Vector3d joint_min_rad_;
  Eigen::Vector3d joint_max_rad_;
  double period_s_;

  Trace* trace_ = nullptr;
  std::array<std::int32_t, 6> counts_{};
  double time_s_ = 0.0;
  double start_s_ = 0.0;
  bool has_time_ = false;
  driver::ArmPose pose_;
  Eigen::Vector3d speed_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d integral_Nm_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_rad_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d most_A_ = Eigen::Vector3d::Zero();
  double away_since_s_ = -1.0;
  double weak_since_s_ = -1.0;
  double fastest_m_per_s_ = 0.0;
};

}  // namespace forcegrid::calibration
