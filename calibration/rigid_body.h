// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>

#include "driver/mechanism.h"
#include "profiles/device_profile.h"

namespace forcegrid::calibration {

/// The weight and inertia of a device, by its profile's link data, which a calibration takes as
/// given: links with the profile's masses, a moving mass at the tip, an inertia at each joint, and
/// a known mass that a person has fastened to the tip.
///
///   tau_rigid = (m + m_w) J^T x'' + I q'' + tau_links(q) + m_w g J^T z
///
/// with the tip x in the device frame D, J = dx/dq, m = dynamics.tip_mass_kg, I =
/// dynamics.joint_inertia_kg_m2, m_w the known mass and tau_links the torque that holds the links.
/// J^T x'' has the Coriolis and centrifugal terms of a point mass in it.
/// Source: Khalil and Dombre, Modeling, Identification and Control of Robots (2002), ch. 9.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class RigidBody {
 public:
  RigidBody(const profiles::DeviceProfile& profile, double known_mass_kg);
  RigidBody(const RigidBody& other) : RigidBody(other.profile_, other.known_mass_kg_) {
    offset_counts_ = other.offset_counts_;
  }
  RigidBody& operator=(const RigidBody&) = delete;

  /// Pose at a report's counters after `offset_counts` is added to each.
  [[nodiscard]] driver::ArmPose pose(const std::array<std::int32_t, 6>& counts) noexcept;
  void set_offset_counts(const std::array<std::int32_t, 3>& offset_counts) noexcept {
    offset_counts_ = offset_counts;
  }
  [[nodiscard]] const std::array<std::int32_t, 3>& offset_counts() const noexcept {
    return offset_counts_;
  }

  /// [Nm] The torque that holds links and known mass still.
  [[nodiscard]] Eigen::Vector3d holding_Nm(const driver::ArmPose& pose) const noexcept;
  /// [Nm] The torque that accelerates them, without weight.
  [[nodiscard]] Eigen::Vector3d inertial_Nm(
      const driver::ArmPose& pose, const Eigen::Vector3d& tip_acceleration_D_m_per_s2,
      const Eigen::Vector3d& joint_acceleration_rad_per_s2) const noexcept;
  /// [kg m^2] The inertia at each joint while the others stand still.
  [[nodiscard]] Eigen::Vector3d joint_inertia_kg_m2(const driver::ArmPose& pose) const noexcept;

  [[nodiscard]] double known_mass_kg() const noexcept { return known_mass_kg_; }

 private:
  profiles::DeviceProfile profile_;
  std::unique_ptr<driver::Mechanism> mechanism_;
  bool links_weigh_;
  double known_mass_kg_;
  double moving_mass_kg_;
  double joint_inertia_kg_m2_;
  double gravity_m_per_s2_;
  std::array<std::int32_t, 3> offset_counts_{};
};

}  // namespace forcegrid::calibration
