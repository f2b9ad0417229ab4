// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>

#include "rt/clock.h"

namespace forcegrid::emulator {

/// Lets a hand follow a pointer as fast as a person's hand can, and go back to its script when the
/// pointer lets go. Nothing jumps but the acceleration.
///
/// With e the way from the goal to the hand's target, and e' its speed:
///
///   e'' = -w^2 e - 2 w e',   w = 2 pi kBandwidth_Hz;   |e''| <= kMost_m_per_s2, |e'| <= V
///
/// The goal is the pointer's place, at rest; or, after it has let go, the script's target, which
/// goes on meanwhile. Critically damped, and slow enough that braking from kMost_m_per_s takes
/// w kMost_m_per_s / exp(1) = 11.6 m/s^2: no overshoot. A way of 30 mm is done to 1 % in 0.23 s.
/// V is at most kMost_m_per_s; OperatorScript chooses less, so that the tip, which swings beyond
/// the target on the hand's spring, stays below the speed at which a servo loop takes it for a
/// fault.
///
/// Source of the bandwidth: Draper, Hand acceleration impulse bandwidth during target acquisition,
/// IEEE Trans. Systems, Man, and Cybernetics 24(6), 1994: 5.6 Hz for the joints near the shoulder.
/// Source of the limits: a minimum-jerk reach (Flash and Hogan, J. Neuroscience 5(7), 1985) of 0.3
/// m in 0.6 s peaks at 1.875 d / T = 0.94 m/s and 5.77 d / T^2 = 4.8 m/s^2; a quick one of 0.1 m in
/// 0.2 s at the same speed and 14 m/s^2.
///
/// Real-time: update() neither allocates, locks nor throws; at most kMostSteps steps. Threads: one.
class HandFollower {
 public:
  /// @param most_m_per_s  V; > 0, at most kMost_m_per_s.
  explicit HandFollower(double most_m_per_s = kMost_m_per_s) noexcept
      : most_m_per_s_(std::min(most_m_per_s, kMost_m_per_s)) {}

  static constexpr double kBandwidth_Hz = 5.0;
  static constexpr double kMost_m_per_s = 1.0;
  static constexpr double kMost_m_per_s2 = 20.0;
  static constexpr double kStep_s = 1e-3;
  static constexpr int kMostSteps = 100;  ///< of one update; what is longer is as this

  /// @returns where the hand's target is at `now`, [m] frame D: exactly `script_D` while no pointer
  /// has been followed, or once the hand is back within 0.1 um.
  /// @param script_D  [m] where the script wants the hand at `now`.
  /// @param pointer_D  [m] what it follows; nothing: the script. Finite.
  [[nodiscard]] Eigen::Vector3d update(rt::TimePoint now, const Eigen::Vector3d& script_D,
                                       const std::optional<Eigen::Vector3d>& pointer_D) noexcept;

  /// The hand's target is at `position_D` [m], at rest, and goes from there to where it is wanted.
  void begin_at(const Eigen::Vector3d& position_D) noexcept {
    away_ = true;
    target_D_ = position_D;
    speed_D_.setZero();
  }
  /// Whether the hand is somewhere else than its script wants it.
  [[nodiscard]] bool away() const noexcept { return away_; }

 private:
  double most_m_per_s_;
  bool away_ = false;
  std::optional<rt::TimePoint> last_;
  Eigen::Vector3d script_D_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d script_speed_D_ = Eigen::Vector3d::Zero();  ///< [m/s] between the last two
  Eigen::Vector3d target_D_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d speed_D_ = Eigen::Vector3d::Zero();  ///< [m/s]
};

}  // namespace forcegrid::emulator
