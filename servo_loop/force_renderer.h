// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "driver/kinematics.h"
#include "profiles/device_profile.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/damping_field.h"
#include "servo_loop/degradation_ladder.h"
#include "servo_loop/passivity.h"
#include "servo_loop/virtual_coupling.h"

namespace forcegrid::servo {

struct RenderingOptions {
  LadderOptions ladder;
  /// Replaces a force that has faded. Limited to the profile's largest damping and to a quarter of
  /// its largest force.
  DampingFieldOptions damping_field;
  /// Of the passivity controller; the observer is always on. Its damping is at most the profile's
  /// limits.max_damping_N_s_per_m.
  PassivityOptions passivity;
  /// If set, a virtual coupling stands between the tool and the object.
  std::optional<CouplingOptions> coupling;
};

/// Turns a method's force into the force that is wanted at the hand, before the profile's limits:
/// degradation ladder, workspace bound, virtual coupling, passivity guard.
/// Real-time: no allocation, lock or throw after construction. Threads: one.
class ForceRenderer {
 public:
  /// One cycle's input. The axes of W and D are parallel, so forces are the same in both.
  struct Cycle {
    double elapsed_s = 0.0;
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m] of the tool
    Eigen::Vector3d velocity_W = Eigen::Vector3d::Zero();  ///< [m/s] of MotionGuard
    Eigen::Vector3d method_force_W = Eigen::Vector3d::Zero();
    /// [N] Of other devices' tools, see ToolTouch, which counts its energy. It gets the ladder's
    /// gain and the workspace's bound as the method's does; PassivityGuard does not see it.
    Eigen::Vector3d tool_force_W = Eigen::Vector3d::Zero();
    double sample_age_s = 0.0;     ///< see DegradationLadder::update()
    double sample_period_s = 0.0;  ///< of the simulator
    HeldBack held_back = HeldBack::kNot;
    bool in_contact = false;
  };

  /// After this long out of contact the passivity guard opens a new energy account.
  static constexpr double kContactOver_s = 0.1;

  /// [J/s] Energy granted to the hand while the force ramps in. A force that ramps in on a tool at
  /// rest inside the object brings its energy with it: 3 N that push a light hand of 100 N/m out
  /// within the ramp give 90 mW. Without the grant the force would not come back after a fade.
  static constexpr double kRampPower_J_per_s = 0.1;

  /// @throws std::invalid_argument naming the option that can't be used.
  ForceRenderer(const profiles::DeviceProfile& profile, const RenderingOptions& options);

  /// [m] Where the object is touched by a tool at `position_W`.
  Eigen::Vector3d touching_W(const Eigen::Vector3d& position_W) const noexcept;

  /// [N] The wanted force on the hand; zero outside the profile's box.
  [[nodiscard]] Eigen::Vector3d force(const Cycle& cycle, const driver::ArmPose& pose) noexcept;

  /// Whether the tip is within the profile's box, outside of which there is no force.
  [[nodiscard]] bool in_workspace(const driver::ArmPose& pose) const noexcept;

  /// The force [N] that the limits have left of the last one.
  void set_rendered(const Eigen::Vector3d& force_W) noexcept;
  /// How much of the last cycle's tool_force_W the hand gets, 0..1.
  [[nodiscard]] double tool_force_share() const noexcept { return tool_force_share_; }

  /// Drops the force at once; it comes back by the ramp.
  void drop() noexcept;

  const DegradationLadder& ladder() const noexcept { return ladder_; }
  const PassivityGuard& guard() const noexcept { return guard_; }
  std::uint64_t cycles_damped() const noexcept { return cycles_damped_; }
  std::uint64_t cycles_shortened() const noexcept { return cycles_shortened_; }
  /// Writes what the last cycle did into its record.
  void describe(CycleRecord& record) const noexcept;

 private:
  void account_for_contact(const Cycle& cycle) noexcept;

  DegradationLadder ladder_;
  DampingField damping_field_;
  PassivityGuard guard_;
  std::optional<VirtualCoupling> coupling_;
  Eigen::Matrix3d angle_per_count_rad_;  ///< diagonal, unsigned
  Eigen::Vector3d box_min_D_, box_max_D_;
  Eigen::Vector3d wanted_W_ = Eigen::Vector3d::Zero();      ///< the last force()
  Eigen::Vector3d tool_force_W_ = Eigen::Vector3d::Zero();  ///< its part of other tools
  double tool_force_share_ = 0.0;
  double out_of_contact_s_ = 0.0;
  std::uint64_t cycles_damped_ = 0;
  std::uint64_t cycles_shortened_ = 0;
};

}  // namespace forcegrid::servo
