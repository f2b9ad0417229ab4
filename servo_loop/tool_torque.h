// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace forcegrid::servo {

struct ToolTorqueOptions {
  double max_torque_Nm = 0.2;  ///< bound of the torque's length; above 0
  /// [m] Longest lever arm that a sample's wrench is given; at least 0. What a longer one would
  /// bear stays in the couple.
  double max_lever_m = 0.1;
  /// [rad] Most rotation since the sample that its stiffness is used for; at least 0.
  double max_rotation_rad = 0.5;
  /// [m] Longest way since the sample that its gradient is used for; at least 0.
  double max_shift_m = 0.02;
};

/// The torque to render at the tool in every cycle, from the simulator's late samples.
///
/// A sample is the object's wrench on the tool: force F_s and torque tau_s about the operational
/// point, at the orientation R_s. Its central axis splits it into a lever arm and a couple along
/// the force:
///
///   l = F_s x tau_s / |F_s|^2,  c = tau_s - l x F_s,   |l| <= max_lever_m
///
/// With F the force that is rendered now, theta the rotation vector of R R_s^T in W, d the way
/// since the sample's position, and the sample's K = d(tau)/d(theta), D = d(tau)/dP and J = dF/dP,
///
///   tau = l x F + g (c + K theta + (D - [l]x J) d)         with a stiffness; D = 0 without it
///   tau = (R R_s^T l) x F + g R R_s^T c                    without: held in the tool's frame
///
/// F changes by J d on the way d, which l x F has already: hence [l]x J.
///
/// The lever arm makes the torque follow the force, which a method renders at servo rate and the
/// loop fades and limits. The couple has no force to follow; the gain g fades it as the ladder
/// fades the force. At the sample's pose and force the torque is tau_s. The length is bounded by
/// max_torque_Nm at the end.
///
/// K and D are linear, so their error grows with the square of the motion; max_rotation_rad bounds
/// theta and max_shift_m d. Without D the lever arm holds where the force keeps its place on the
/// tool: a change of position that moves that place is felt with the next sample.
///
/// Source of the axis: Poinsot's central axis, e.g. Murray, Li and Sastry, A Mathematical
/// Introduction to Robotic Manipulation (1994), section 2.5. Real-time: no allocation, lock or
/// throw after construction. Threads: one.
class ToolTorque {
 public:
  /// What a sample tells of the torque. All vectors are expressed in W.
  struct Wrench {
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();   ///< [m] of the operational point
    Eigen::Vector3d force_W = Eigen::Vector3d::Zero();      ///< [N] on the tool
    Eigen::Vector3d torque_W_Nm = Eigen::Vector3d::Zero();  ///< on it, about its position
    Eigen::Quaterniond orientation_WT = Eigen::Quaterniond::Identity();
    bool has_rotational_stiffness = false;
    /// d(torque)/d(theta), at a fixed position.
    Eigen::Matrix3d rotational_stiffness_W_Nm_per_rad = Eigen::Matrix3d::Zero();
    bool has_gradient = false;  ///< the two below are known; used with a rotational stiffness only
    Eigen::Matrix3d gradient_W_N = Eigen::Matrix3d::Zero();         ///< d(torque)/dP
    Eigen::Matrix3d stiffness_W_N_per_m = Eigen::Matrix3d::Zero();  ///< dF/dP
  };

  /// @throws std::invalid_argument naming the option that cannot be used.
  explicit ToolTorque(const ToolTorqueOptions& options);

  /// Takes the newest sample's wrench. One that is not finite, or whose orientation is not a unit
  /// quaternion within 1e-3, is as no sample: see forget().
  void take(const Wrench& wrench) noexcept;

  /// The contact is lost, or the sample has no torque: zero torque until the next take().
  void forget() noexcept { known_ = false; }
  [[nodiscard]] bool known() const noexcept { return known_; }

  /// [N m] On the hand, about the operational point, in W; zero without a sample and for an input
  /// that is not finite.
  /// @param position_W  [m] of the operational point now.
  /// @param orientation_WT  of the tool now, a unit quaternion.
  /// @param force_W  [N] that is rendered now: after gain and limits.
  /// @param gain  0 to 1, the ladder's: DegradationLadder::force_gain().
  [[nodiscard]] Eigen::Vector3d torque_W_Nm(const Eigen::Vector3d& position_W,
                                            const Eigen::Quaterniond& orientation_WT,
                                            const Eigen::Vector3d& force_W,
                                            double gain) const noexcept;

  /// [m] From the operational point to the newest sample's central axis; zero without a sample.
  [[nodiscard]] Eigen::Vector3d lever_W() const noexcept;

 private:
  ToolTorqueOptions options_;
  Wrench wrench_;
  Eigen::Vector3d lever_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d couple_W_Nm_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d couple_gradient_W_N_ = Eigen::Matrix3d::Zero();  ///< D - [l]x J
  bool known_ = false;
};

}  // namespace forcegrid::servo
