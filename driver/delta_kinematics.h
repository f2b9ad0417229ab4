// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"

namespace forcegrid::driver {
#pragma GCC visibility push(default)

/// Where a delta is. Values are valid for kOk, kOutOfRange and kSingular; the Jacobian of a
/// singular pose is zero, so that it carries no force.
struct DeltaPose {
  KinematicsStatus status = KinematicsStatus::kNotFinite;
  Eigen::Vector3d position_B = Eigen::Vector3d::Zero();       ///< [m]
  Eigen::Vector3d joint_angle_rad = Eigen::Vector3d::Zero();  ///< theta_1 of legs 1..3
  /// [m/rad] d(position_B)/dtheta, columns legs 1..3.
  Eigen::Matrix3d jacobian_B = Eigen::Matrix3d::Zero();
};

/// How a delta gets somewhere. Values are valid for kOk and kOutOfRange.
struct DeltaInverse {
  KinematicsStatus status = KinematicsStatus::kNotFinite;
  Eigen::Vector3d joint_angle_rad = Eigen::Vector3d::Zero();
  Eigen::Vector3d counts = Eigen::Vector3d::Zero();  ///< not rounded
};

/// Kinematics of a delta mechanism such as the Novint Falcon's, in its base frame B: origin on the
/// base, x to the user's right, y up, z out of the device toward the user. With p = (x, y, z), leg
/// i has
///
///   Q_u =  x cos phi_i + y sin phi_i - r + c
///   Q_v = -x sin phi_i + y cos phi_i - s + f
///   Q_w =  z
///   b cos theta_3 = Q_v
///   (Q_u - a cos theta_1)^2 + (Q_w - a sin theta_1)^2 = (d + e + b sin theta_3)^2
///
/// where theta_1 is the driven angle, theta_2 the shin's direction in the leg's plane, and
/// sin(theta_2 - theta_1) > 0 (elbow out).
/// Source: R. E. Stamper, thesis (1997), eqs 3.7-3.22.
/// Real-time: every const function is bounded and neither allocates, locks nor throws.
/// Threads: const functions from any thread.
class DeltaKinematics {
 public:
  /// sin(theta_2 - theta_1) below this is singular: arm and shin of a leg within 1.1 degrees of
  /// aligned.
  static constexpr double kSingularSine = 0.02;
  /// |det J_v| over the product of its rows' lengths below this is singular: the legs do not hold
  /// the platform.
  static constexpr double kSingularVolume = 0.01;
  /// Steps of Newton's method from one start value; from the spheres it needs 6.
  static constexpr int kMaxSteps = 10;

  explicit DeltaKinematics(const profiles::DeviceProfile::Delta& geometry);

  /// Forward kinematics and Jacobian by Newton's method on
  ///
  ///   F_i(p) = hypot(Q_u - a cos theta_1, Q_w - a sin theta_1) - (d + e) - sqrt(b^2 - Q_v^2) = 0
  ///
  /// whose last step is below 1e-12 m, so that the error is rounding. The Jacobian is the inverse
  /// of
  ///
  ///   J_v(i,.) = dF_i/dp / (a sin(theta_2 - theta_1)),   theta' = J_v p'
  ///
  /// @param joint_angle_rad  theta_1 of legs 1..3.
  /// @param start_B  [m] where to begin, e.g. the pose before. From there, or where that does not
  ///        lead to the branch, from sphere_start().
  /// @returns kUnreachable when neither leads anywhere within kMaxSteps.
  [[nodiscard]] DeltaPose forward(const Eigen::Vector3d& joint_angle_rad,
                                  const Eigen::Vector3d& start_B) const noexcept;

  /// The same without an idea of where it is.
  [[nodiscard]] DeltaPose forward(const Eigen::Vector3d& joint_angle_rad) const noexcept;

  /// The start value: the outer (+z) intersection of three spheres of radius b + d + e about the
  /// knees; at most 14 mm off in the Falcon's force box, 17 mm at its ends. Not finite where they
  /// do not meet.
  [[nodiscard]] Eigen::Vector3d sphere_start(const Eigen::Vector3d& joint_angle_rad) const noexcept;

  /// Inverse kinematics in closed form:
  ///
  ///   L = d + e + b sin theta_3,  R = hypot(Q_u, Q_w)
  ///   theta_1 = atan2(Q_w, Q_u) - acos((R^2 + a^2 - L^2) / (2 a R))
  ///
  /// @returns kUnreachable for |Q_v| > b or a cosine beyond +-1, kSingular next to the latter.
  [[nodiscard]] DeltaInverse inverse(const Eigen::Vector3d& position_B) const noexcept;

  /// Joint torque [Nm] that exerts `force_B` [N] on the hand: tau = J^T F.
  [[nodiscard]] static Eigen::Vector3d joint_torque(const DeltaPose& pose,
                                                    const Eigen::Vector3d& force_B) noexcept {
    return pose.jacobian_B.transpose() * force_B;
  }

  [[nodiscard]] Eigen::Vector3d angles_of_counts(const Eigen::Vector3d& counts) const noexcept;
  [[nodiscard]] Eigen::Vector3d counts_of_angles(
      const Eigen::Vector3d& joint_angle_rad) const noexcept;

 private:
  struct Driven;
  bool newton(const Driven& driven, DeltaPose& pose) const noexcept;
  bool within_stops(const Eigen::Vector3d& joint_angle_rad) const noexcept;

  profiles::DeviceProfile::Delta geometry_;
  std::array<double, 3> cos_azimuth_;
  std::array<double, 3> sin_azimuth_;
  double end_pieces_m_;  ///< d + e
  double offset_u_m_;    ///< c - r
  double offset_v_m_;    ///< f - s
  double orientation_;   ///< sign of det(dF/dp) with the platform outside the knees
};

#pragma GCC visibility pop
}  // namespace forcegrid::driver
