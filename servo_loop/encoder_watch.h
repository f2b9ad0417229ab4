// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "driver/device.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::servo {

/// Finds encoders that have stopped counting while their motor pushes.
///
/// A joint that stands still under load proves nothing: a hand can hold it against any torque, and
/// within twice the Coulomb friction tau_c not even a change of torque moves it. But no live joint
/// stays still when a torque far above friction is removed. Each joint is judged alone, with
/// tau_F = J^T F the torque of the rendered force (the torque that carries the links stays):
///
///   suspected:  |tau_F| > kFrictions tau_c, and no count for kSuspectAfter;
///   relieved:   its torque falls to zero within kReliefTime, until a count comes;
///   unmoved:    kSuspectAfter + kReliefTime after the last count there is still none:
///               the torque of all joints is zero;
///   frozen:     kProofTime later there is still no count.
///
/// A live joint moves during the relief, by what friction had hidden, unless the hand turns back at
/// that moment and takes away what the relief adds. Of a thousand reliefs of a Falcon in a firm
/// hand that moves at random, one or two last longer than 36 ms. So no joint is called frozen
/// before all motors have been without torque for a while. A joint that has moved is not suspected
/// again for kPatience, unless it moves on by itself: what joints do while torque is taken away or
/// given back, and for kSettleTime after, is the relief's doing.
///
/// These times run only while reports come: a gap of more than kYoung between two reports counts
/// for nothing. During such a silence no count can come, and no command reaches a device that takes
/// one per report, so its motors keep their torque. One report adds at most kCredit. Where each
/// report takes long, the commanded zero takes as long to reach the motors and its effect as long
/// to come back, so the number of reports is what counts.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class EncoderWatch {
 public:
  static constexpr double kFrictions = 5.0;
  static constexpr rt::Duration kSuspectAfter = std::chrono::milliseconds(60);
  static constexpr rt::Duration kReliefTime = std::chrono::milliseconds(40);
  static constexpr rt::Duration kProofTime = std::chrono::milliseconds(60);
  static constexpr rt::Duration kPatience = std::chrono::seconds(1);
  /// A report older than this, or later than this after the last, proves nothing: silence is a
  /// fault of its own kind, see MotionGuard.
  static constexpr rt::Duration kYoung = std::chrono::milliseconds(15);
  /// At most this much time without a count is credited to one report.
  static constexpr rt::Duration kCredit = std::chrono::milliseconds(4);
  /// How long a relief moves joints after all torque is back: a hand that holds them swings.
  static constexpr rt::Duration kSettleTime = std::chrono::milliseconds(150);
  /// Counts after which a joint has moved on by itself.
  static constexpr std::int32_t kMovedOn_counts = 5;

  explicit EncoderWatch(const profiles::DeviceProfile& profile) noexcept;

  /// Takes one cycle's report. @returns the joint (0, 1, 2) whose encoder is frozen, if any.
  [[nodiscard]] std::optional<int> check(rt::TimePoint now,
                                         const driver::DeviceReport& report) noexcept;

  /// The part of each joint's torque that may be commanded, 0..1.
  /// @param force_torque_Nm J^T F of the force that is to be rendered, all of it.
  [[nodiscard]] Eigen::Array3d relief(rt::TimePoint now, double elapsed_s,
                                      const Eigen::Vector3d& force_torque_Nm) noexcept;

  /// Nothing has been rendered for a while: forgets all joints. The counter goes on.
  void restart() noexcept;

  /// How often a joint has been suspected, since construction.
  [[nodiscard]] std::uint64_t suspected_stuck_encoders() const noexcept {
    return suspected_stuck_encoders_;
  }

 private:
  struct Joint {
    bool known = false;
    std::int32_t counts = 0;
    rt::Duration still_since{};   ///< by watched_
    rt::Duration loaded_since{};  ///< by watched_
    bool loaded = false;
    bool suspected = false;
    rt::TimePoint suspected_since{};
    rt::Duration watched_when_suspected{};
    rt::TimePoint suspect_no_sooner{};
    std::int32_t travel_counts = 0;
    double part = 1.0;  ///< of the torque that may be commanded
  };

  /// Suspected, relieved of all its torque for kReliefTime, and still without a count.
  [[nodiscard]] bool unmoved(const Joint& joint) const noexcept;

  profiles::Axes loaded_above_Nm_;
  std::array<Joint, 3> joints_;
  rt::TimePoint settled_from_{};  ///< later motion is not a relief's doing
  std::uint64_t last_sequence_ = 0;
  rt::TimePoint last_released_{};
  rt::Duration
      watched_{};  ///< how long reports have come one soon after the other, by their credit
  std::uint64_t suspected_stuck_encoders_ = 0;
};

}  // namespace forcegrid::servo
