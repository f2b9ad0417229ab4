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

/// One step of a motion: the current that flowed, and the counters after it.
struct TracePoint {
  double time_s = 0.0;  ///< of the counters
  std::array<std::int32_t, 6> counts{};
  /// Of the command that flowed until then, by the profile's torque constants.
  Eigen::Vector3d joint_torque_Nm = Eigen::Vector3d::Zero();
};
using Trace = std::vector<TracePoint>;

/// The target of the joints.
struct JointTarget {
  Eigen::Vector3d angle_rad = Eigen::Vector3d::Zero();
  Eigen::Vector3d speed_rad_per_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d acceleration_rad_per_s2 = Eigen::Vector3d::Zero();
};

/// A joint that gives a constant torque instead of holding an angle, in addition to the holding
/// torque.
struct Press {
  int joint = 0;
  double torque_Nm = 0.0;
};

/// Moves the joints of a device that no hand holds, slowly and weakly, and gives up if something is
/// not as expected.
///
///   tau = tau_hold(q) + I_j (q''_t + w^2 e + 2 w e') + k_i integral(e),   e = q_t - q
///
/// with I_j the inertia at a joint and w = kBandwidth_rad_per_s. Torques stay below half of the
/// profile's limits for torque and current. Motors get zero before an exception leaves.
///
/// Real-time: step() allocates only where it records or throws. Threads: one.
class HeldArm {
 public:
  static constexpr double kBandwidth_rad_per_s = 25.0;
  /// Of the profile's largest speed; motions are planned with kPlannedSpeed of it.
  static constexpr double kSpeedLimit = 0.6;
  static constexpr double kPlannedSpeed = 0.3;
  /// [rad] A joint that is further from its target than this for kAwayFor_s ends the motion.
  static constexpr double kAway_rad = 0.3;
  static constexpr double kAwayFor_s = 0.3;
  /// [rad] Beyond the profile's stops: they give, and pose and profile may be a little wrong.
  static constexpr double kBeyondStop_rad = 0.35;
  /// Warmth, where 1 is that of the continuous current. A pause cools down to the first; above the
  /// second there is a pause before the next motion; the third ends a motion.
  static constexpr double kCool = 0.42;
  static constexpr double kWarm = 0.5;
  static constexpr double kTooWarm = 0.97;

  /// @param body  outlives it. Begins with a step of zero current, at the arm's present pose.
  HeldArm(Rig& rig, const profiles::DeviceProfile& profile, RigidBody& body);

  /// @throws CalibrationError, see above; what Rig::step() throws.
  void step(const JointTarget& target, std::optional<Press> press = std::nullopt);
  /// Holds the present target.
  void hold(double time_s);
  /// Moves all joints there, smoothly, at a planned speed.
  void move_to(const Eigen::Vector3d& angle_rad);
  /// [s] How long move_to() takes over `way_rad`.
  [[nodiscard]] double move_s(const Eigen::Vector3d& way_rad) const noexcept;
  /// Rests at `angle_rad` until the motors are cool enough for a motion.
  void cool(const Eigen::Vector3d& angle_rad);
  /// Whether it should cool before the next motion.
  [[nodiscard]] bool warm() const noexcept { return warmth_.warmest() > kWarm; }
  /// Zero current.
  void release();

  /// Steps are appended to `trace` until record(nullptr); it outlives that.
  void record(Trace* trace) noexcept { trace_ = trace; }
  /// The counters have a new offset: the present pose becomes the target.
  void forget_target() noexcept;

  [[nodiscard]] const driver::ArmPose& pose() const noexcept { return pose_; }
  [[nodiscard]] const Eigen::Vector3d& speed_rad_per_s() const noexcept { return speed_; }
  [[nodiscard]] const std::array<std::int32_t, 6>& counts() const noexcept { return counts_; }
  [[nodiscard]] double time_s() const noexcept { return time_s_; }
  [[nodiscard]] double period_s() const noexcept { return period_s_; }
  /// [rad/s] planned for each joint in this pose, so that the tip keeps kPlannedSpeed.
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
