// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "device_emulator/hand_follower.h"
#include "device_emulator/hand_motion.h"
#include "device_emulator/wrist_motion.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// What the person who holds the arm does, as the hand's target over time:
///
/// 1. keeps still in the calibration pose until a host has fed the watchdog for 0.2 s, then presses
///    the calibration button (unless that host has already loaded the counters) and keeps still
///    until command 1 loads them (`calibrated`: both are skipped). A device with a `homing` gesture
///    is instead pulled out and pushed in repeatedly until all its axes are homed, and then brought
///    back within 1.2 s;
/// 2. moves in 1.2 s to the approach point, 10 mm above the contact point, and in 0.5 s down to 0.5
///    mm below the contact height, both minimum-jerk, and waits 0.5 s;
/// 3. makes the motion relative to that point, without end;
/// 4. when the host has gone (device detached, or silent for 2 s), returns in 1.2 s to the
///    calibration pose and starts again with the next host.
///
/// An operator who lets go keeps still in the calibration pose instead of 2 and 3, and takes the
/// hand away for good kLetGo_s after the counters have become right.
///
/// From the approach on, until the host has gone, the hand follows a pointer instead if there is
/// one (Senses::pointer_D), within its reach; the script's time goes on meanwhile, and once the
/// pointer has let go the hand returns to where the script then is (HandFollower).
///
/// On a device with a wrist the hand turns it: from the calibration pose to where the wrist's
/// motion begins while it approaches, along with the motion in 3, and back in 4. With a stylus
/// button it presses for kClick_s in every `click_every_s` of the motion.
///
/// The target never jumps. Time is an argument and must not decrease.
/// Real-time: update() neither allocates, locks nor throws. Threads: one.
class OperatorScript {
 public:
  /// Where the operator pulls a device, and then pushes it, to home it. [m] frame D.
  struct HomingGesture {
    Eigen::Vector3d out_D = Eigen::Vector3d::Zero();
    Eigen::Vector3d in_D = Eigen::Vector3d::Zero();
  };

  struct Options {
    MotionKind motion = MotionKind::kChirp;
    double amplitude_m = HandMotion::kNominalAmplitude_m;  ///< see HandMotion
    std::vector<PathPoint> path{};                         ///< of motion kPath
    std::uint64_t seed = 1;
    bool calibrated = false;
    bool lets_go = false;
    Eigen::Vector3d contact_D = Eigen::Vector3d::Zero();  ///< [m] frame D
    double approach_height_m = 0.010;                     ///< approach point above contact_D
    double contact_depth_m = 0.0005;                      ///< how far below contact_D the tool goes
    std::optional<HomingGesture> homing{};                ///< nothing: a button calibrates
    /// [m] Frame D: the box that a pointer is clamped to.
    Eigen::Vector3d reach_low_D = Eigen::Vector3d::Constant(-1.0);
    Eigen::Vector3d reach_high_D = Eigen::Vector3d::Constant(1.0);
    double reach_m_per_s = 0.5;  ///< largest speed after a pointer, see HandFollower
    WristMotionKind wrist_motion = WristMotionKind::kTurn;
    Eigen::Vector3d wrist_rest_rad = Eigen::Vector3d::Zero();   ///< in the calibration pose
    Eigen::Vector3d wrist_reach_rad = Eigen::Vector3d::Zero();  ///< see WristMotion
    double click_every_s = 0.0;                                 ///< of the stylus; 0: never
  };

  /// What the operator sees of the device.
  struct Senses {
    bool host_present = false;          ///< configured, and the watchdog has been fed lately
    std::uint64_t counters_loaded = 0;  ///< how often command 1 has been executed
    bool homed = false;                 ///< all axes; of a device with a homing gesture
    /// [m] Where the hand is wanted, frame D; finite. Nothing: where the script wants it.
    std::optional<Eigen::Vector3d> pointer_D{};
  };

  struct Action {
    Eigen::Vector3d target_D = Eigen::Vector3d::Zero();    ///< [m] of the hand, frame D
    bool press_button = false;                             ///< press the calibration button now
    bool let_go = false;                                   ///< take the hand away now
    Eigen::Vector3d gimbal_rad = Eigen::Vector3d::Zero();  ///< joint angles of the wrist
    bool stylus_pressed = false;
  };

  enum class Phase : std::uint8_t { kWaiting, kCalibrating, kApproaching, kMoving, kReturning };

  /// @param home_D [m] tip in the calibration pose, frame D.
  OperatorScript(const Options& options, const Eigen::Vector3d& home_D);
  /// The options with a hand's reach on a device of this profile: its workspace, at half of the
  /// speed that its limits allow, since the tip swings beyond the hand's target; and with its
  /// wrist.
  static Options on_device(Options options, const profiles::DeviceProfile& profile);

  [[nodiscard]] Action update(rt::TimePoint now, const Senses& senses) noexcept;
  /// A hand takes the tip at `position_D` [m], and goes from there to where it is wanted.
  void take_at(const Eigen::Vector3d& position_D) noexcept { follower_.begin_at(position_D); }
  [[nodiscard]] Phase phase() const noexcept { return phase_; }

  static constexpr double kButtonDelay_s = 0.2;
  static constexpr double kApproach_s = 1.2;
  static constexpr double kDescent_s = 0.5;
  static constexpr double kPause_s = 0.5;
  static constexpr double kLetGo_s = 3.0;
  static constexpr double kReturn_s = 1.2;
  static constexpr double kHomingStroke_s = 1.5;
  static constexpr double kHomingPause_s = 0.3;
  static constexpr double kClick_s = 0.3;

 private:
  /// [m] The target `since_s` [s] after the homing gesture began.
  Eigen::Vector3d homing_target_D(double since_s) const noexcept;
  /// [rad] The wrist `since_s` [s] after the phase began.
  Eigen::Vector3d gimbal_target_rad(double since_s) const noexcept;

  Options options_;
  HandMotion motion_;
  WristMotion wrist_motion_;
  HandFollower follower_;
  Eigen::Vector3d home_D_;
  Eigen::Vector3d target_D_;
  Eigen::Vector3d return_from_D_;
  Eigen::Vector3d gimbal_rad_;
  Eigen::Vector3d return_from_gimbal_rad_;
  Phase phase_ = Phase::kWaiting;
  rt::TimePoint phase_start_{};
  std::optional<rt::TimePoint> host_since_;
  std::optional<rt::TimePoint> calibrated_since_;
  bool has_let_go_ = false;
  std::uint64_t loads_before_host_ = 0;
};

}  // namespace forcegrid::emulator
