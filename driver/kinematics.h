// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

enum class KinematicsStatus : std::uint8_t {
  kOk,
  kOutOfRange,   ///< the pose is beyond the arm's hard stops: not calibrated, or counts lost
  kSingular,     ///< the links are folded or stretched, or the tip is on the base axis
  kUnreachable,  ///< no pose of the arm puts the tip there
  kNotFinite,    ///< an input was NaN or infinite; every output is zero
};

/// Static text, e.g. "beyond the hard stops".
const char* to_string(KinematicsStatus status) noexcept;

/// Three values of a profile, as one array.
Eigen::Array3d array_of(const profiles::Axes& axes);

/// [rad] The angle of one encoder count, without its sign: of joints a, b, c of an arm, or of the
/// legs of a delta.
Eigen::Array3d angle_per_count_rad(const profiles::DeviceProfile& profile) noexcept;

/// Where the arm is. Values are valid for kOk, kOutOfRange and kSingular.
struct ArmPose {
  KinematicsStatus status = KinematicsStatus::kNotFinite;
  Eigen::Vector3d position_D = Eigen::Vector3d::Zero();       ///< [m] tip
  Eigen::Vector3d joint_angle_rad = Eigen::Vector3d::Zero();  ///< q_a, q_b, q_c
  /// [m/rad] d(position_D)/dq, columns a, b, c.
  Eigen::Matrix3d jacobian_D = Eigen::Matrix3d::Zero();

  // Of a device with a wrist, see GimbalKinematics; the identity and zeros of one without.
  bool has_orientation = false;
  Eigen::Matrix3d rotation_DT = Eigen::Matrix3d::Identity();   ///< tool frame T to D
  Eigen::Vector3d gimbal_angle_rad = Eigen::Vector3d::Zero();  ///< g_1, g_2, g_3
  /// Angular velocity of T in D per joint speed: columns of a, b, c, and of g_1, g_2, g_3.
  Eigen::Matrix3d arm_axis_D = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d gimbal_axis_D = Eigen::Matrix3d::Zero();
};

/// How the arm gets somewhere. Values are valid for kOk and kOutOfRange.
struct ArmInverse {
  KinematicsStatus status = KinematicsStatus::kNotFinite;
  Eigen::Vector3d joint_angle_rad = Eigen::Vector3d::Zero();  ///< q_a, q_b, q_c
  Eigen::Vector3d counts = Eigen::Vector3d::Zero();           ///< not rounded
};

/// A current as the report has it.
struct ReportCurrent {
  bool finite = true;  ///< false: an input was NaN or infinite, and all three are zero
  bool clamped = false;
  std::array<std::int16_t, 3> current_mA{};
};

/// Kinematics of the WoodenHaptics family, which also describes the PHANTOM class: a yawing base a
/// carries two links b and c in a vertical plane; the elbow is driven through a parallelogram, so
/// theta_c is absolute.
///
///   q_i     = s_i (2 pi n_i / cpr_i) (d_i / D_i)            joint angle of counter n_i
///   theta_i = offset_i + sign_i q_i                         theta_b from the vertical, theta_c
///   from
///                                                           straight down, both toward the user
///   r = L_b sin theta_b + L_c sin theta_c
///   x = r cos theta_a - o_x,  y = r sin theta_a - o_y
///   z = L_a + L_b cos theta_b - L_c cos theta_c - o_z
///
/// Frame D: x toward the user, y to the user's right, z up; its origin is the profile's o.
/// Source: haptikfabrikenapi src/kinematics.cpp (forward); inverse and gravity derived.
/// Real-time: every const function is bounded and neither allocates, locks nor throws.
/// Threads: const functions from any thread.
class ArmKinematics {
 public:
  /// |sin(theta_b + theta_c)| below this is singular: links within 0.6 degrees of folded or
  /// stretched.
  static constexpr double kSingularSine = 0.01;
  /// [m] The tip nearer to the base axis than this is singular; so is a tip that passed over it.
  static constexpr double kSingularRadius_m = 1e-3;
  /// [rad] Hard stops give: a pose is out of range only this far beyond them.
  static constexpr double kStopTolerance_rad = 0.05;

  explicit ArmKinematics(const profiles::DeviceProfile& profile);
  /// The same from a profile's tables, for a program without files.
  ArmKinematics(const profiles::DeviceProfile::Kinematics& arm,
                const profiles::DeviceProfile::Motors& motors,
                const profiles::DeviceProfile::Gravity& gravity) noexcept;

  /// Forward kinematics and Jacobian of encoder counts a, b, c (need not be whole numbers).
  [[nodiscard]] ArmPose forward(const Eigen::Vector3d& counts) const noexcept;

  /// The same from a report's counters; d, e and f are not used.
  [[nodiscard]] ArmPose forward(const std::array<std::int32_t, 6>& counts) const noexcept;

  /// The same from joint angles.
  /// @param joint_angle_rad  q_a, q_b, q_c.
  [[nodiscard]] ArmPose forward_from_angles(const Eigen::Vector3d& joint_angle_rad) const noexcept;

  /// Inverse kinematics, the branch with the elbow out (0 < theta_b + theta_c < pi, r > 0):
  ///
  ///   X = x + o_x, Y = y + o_y, h = z + o_z - L_a, r = hypot(X, Y), D^2 = r^2 + h^2
  ///   theta_a = atan2(Y, X)
  ///   S = acos((L_b^2 + L_c^2 - D^2) / (2 L_b L_c))
  ///   theta_b = atan2(r, h) - acos((L_b^2 + D^2 - L_c^2) / (2 L_b D)),  theta_c = S - theta_b
  ///
  /// @param position_D  [m]
  /// @returns kUnreachable unless |L_b - L_c| < D < L_b + L_c, kSingular on the base axis and next
  ///          to the ends of the reach.
  [[nodiscard]] ArmInverse inverse(const Eigen::Vector3d& position_D) const noexcept;

  /// Joint torque that exerts `force_D` at the tip: tau = J^T F [Nm].
  [[nodiscard]] static Eigen::Vector3d joint_torque(const ArmPose& pose,
                                                    const Eigen::Vector3d& force_D) noexcept;

  /// Joint torque [Nm] that holds the links' weight:
  ///
  ///   U = g m_B l_B cos theta_b + g m_C (L_b cos theta_b - l_C cos theta_c)
  ///   tau_theta_b = dU/dtheta_b = -g (m_B l_B + m_C L_b) sin theta_b
  ///   tau_theta_c = dU/dtheta_c = g m_C l_C sin theta_c,   tau_q_i = sign_i tau_theta_i
  ///
  /// Zero for a NaN pose. Source: derived from U; the published code's terms are not a static
  /// balance.
  [[nodiscard]] Eigen::Vector3d gravity_torque(
      const Eigen::Vector3d& joint_angle_rad) const noexcept;

  /// Potential energy U of the links [J], as above.
  [[nodiscard]] double potential_energy_J(const Eigen::Vector3d& joint_angle_rad) const noexcept;

  /// Motor current [A] for a joint torque [Nm]: I_i = s_i tau_i (d_i / D_i) / k_i. Not limited.
  [[nodiscard]] Eigen::Vector3d motor_current_A(
      const Eigen::Vector3d& joint_torque_Nm) const noexcept;

  /// Joint torque [Nm] that a motor current [A] gives; the inverse of motor_current_A().
  [[nodiscard]] Eigen::Vector3d joint_torque_of_current(
      const Eigen::Vector3d& current_A) const noexcept;

  /// Report value [mA] of a current [A]: 1000 I truncated toward zero. It is limited in double,
  /// before it is narrowed, to one milliampere below the profile's largest current. A NaN or
  /// infinity in any of the three makes all three zero.
  [[nodiscard]] ReportCurrent report_current(const Eigen::Vector3d& current_A) const noexcept;

  /// Encoder counts of joint angles [rad]; not rounded.
  [[nodiscard]] Eigen::Vector3d counts_of_angles(
      const Eigen::Vector3d& joint_angle_rad) const noexcept;

 private:
  bool within_stops(const Eigen::Vector3d& joint_angle_rad, double elbow_rad) const noexcept;

  Eigen::Array3d origin_m_;
  Eigen::Array3d angle_per_count_rad_;          ///< signed
  Eigen::Array3d current_per_torque_A_per_Nm_;  ///< signed
  Eigen::Array3d max_current_A_;
  Eigen::Array3d linkage_sign_;
  Eigen::Array3d linkage_offset_rad_;
  Eigen::Array3d joint_min_rad_;
  Eigen::Array3d joint_max_rad_;
  double length_a_m_;
  double length_b_m_;
  double length_c_m_;
  double elbow_min_rad_;
  double elbow_max_rad_;
  double weight_b_Nm_;  ///< g (m_B l_B + m_C L_b)
  double weight_c_Nm_;  ///< g m_C l_C
};

#pragma GCC visibility pop
}  // namespace forcegrid::driver
