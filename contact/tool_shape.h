// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <span>

namespace forcegrid::contact {

/// All points within `radius_m` of a straight axis; a sphere if the axis has no length. T is the
/// tool's frame: its origin is the operational point, its axes are parallel to W's unless the tool
/// is turned.
struct Capsule {
  Eigen::Vector3d from_T = Eigen::Vector3d::Zero();  ///< [m] one end of the axis
  Eigen::Vector3d to_T = Eigen::Vector3d::Zero();    ///< [m] the other
  double radius_m = 0.0;
};

/// A rigid tool: one capsule, or the two jaws of a grasper. The operational point is its tip, so
/// that an upright tool that comes down on a flat surface touches it there, as a point would. A
/// device with a wrist turns the tool about that point.
///
/// Threads: a value; const calls from any.
class ToolShape {
 public:
  enum class Kind { kSphere, kCapsule, kGrasper };

  static constexpr double kMinRadius_m = 1e-4;
  static constexpr double kMaxRadius_m = 0.1;
  static constexpr double kMaxLength_m = 0.5;
  static constexpr double kMaxOpening_rad = 1.6;

  /// A sphere that hangs above its tip: its centre is at (0, 0, radius) in T.
  /// @param radius_m  kMinRadius_m to kMaxRadius_m.
  /// @throws Error naming the size that is out of range, as capsule() and grasper() do.
  static ToolShape sphere(double radius_m);

  /// A rod with round ends, `length_m` between the centres of those ends.
  /// @param length_m  0 to kMaxLength_m.
  /// @param axis_W  from the tip to the other end; any length but zero.
  static ToolShape capsule(double radius_m, double length_m,
                           const Eigen::Vector3d& axis_W = Eigen::Vector3d::UnitZ());

  /// A blade or edge: a thin rod that lies along T's x axis, its middle above the tip.
  /// @param length_m  between the centres of its round ends, 0 to kMaxLength_m.
  static ToolShape blade(double radius_m, double length_m);

  /// Two capsules that meet in a hinge above the tip and open in W's x-z plane, each turned by half
  /// of the opening. Closed they are one upright capsule.
  /// @param length_m  of a jaw from the hinge's centre to the centre of its round end.
  /// @param opening_rad  the angle between the jaws, 0 to kMaxOpening_rad.
  static ToolShape grasper(double radius_m, double length_m, double opening_rad);

  Kind kind() const noexcept { return kind_; }
  /// As the tool is turned: from the operational point, along W's axes.
  std::span<const Capsule> parts() const noexcept { return {parts_.data(), count_}; }
  /// [m] The farthest that a point of the tool is from the operational point.
  double reach_m() const noexcept;
  double opening_rad() const noexcept { return opening_rad_; }

  /// Opens or closes a grasper. The angle is clamped to the range; an angle that is not finite is
  /// ignored. Other tools are not changed.
  /// Real-time: no allocation, lock or throw.
  void set_opening(double opening_rad) noexcept;

  /// Turns the tool about the operational point: a_W = R(orientation_WT) a_T. A quaternion that is
  /// not finite, or zero, is ignored. Not turned, every number is what it is without this.
  /// Real-time: no allocation, lock or throw.
  void set_orientation(const Eigen::Quaterniond& orientation_WT) noexcept;
  const Eigen::Quaterniond& orientation_WT() const noexcept { return orientation_WT_; }
  const Eigen::Matrix3d& rotation_WT() const noexcept { return rotation_WT_; }

 private:
  ToolShape() = default;
  void turn_parts() noexcept;

  Kind kind_ = Kind::kSphere;
  std::array<Capsule, 2> upright_{};
  std::array<Capsule, 2> parts_{};
  Eigen::Quaterniond orientation_WT_ = Eigen::Quaterniond::Identity();
  Eigen::Matrix3d rotation_WT_ = Eigen::Matrix3d::Identity();
  std::size_t count_ = 0;
  double length_m_ = 0.0;
  double opening_rad_ = 0.0;
};

}  // namespace forcegrid::contact
