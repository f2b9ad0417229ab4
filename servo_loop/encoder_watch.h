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
/// Standing still is no proof: a hand can hold a joint against any torque, and within twice the
/// Coulomb friction tau_c not even a change of torque moves it. What no live joint can hide is
/// this: a torque far above friction is taken away, and nothing moves. So for each joint alone,
///
///   suspected:  |tau_F| > kFrictions tau_c, and no count for kSuspectAfter;
///   relieved: its torque is led to zero within kReliefTime, until a count comes;
///   unmoved:  it is zero, kSuspectAfter + kReliefTime after the last count, and still no count:
///   now
///             all joints' torque is zero;
///   frozen:   kProofTime later there is still no count.
///
/// where tau_F = J^T F is the torque of the rendered force (the links' weight is not taken away).
/// A live joint moves during the relief, by what friction had hidden, unless the hand turns back
/// just then and takes away what the relief adds: of a thousand reliefs of a Falcon in a firm hand
/// that moves at random, one or two last longer than 36 ms. So nothing is decided before the motors
/// have been without any torque for a while. A joint that has moved is not suspected again for
/// kPatience, unless it has moved on by itself.
///
/// The times of doubting and freezing run only while reports come: what lies between two reports
/// more than kYoung apart counts for nothing. In such a silence no count can come, and no command
/// reaches a device that takes one for each report, so that its motors keep their torque. And a
/// report gives at most kCredit: where each takes long, the zero that was commanded takes as long
/// to reach the motors and what it does as long to come back, so that what counts is how many came.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class EncoderWatch {
 public:
  static constexpr double kFrictions = 5.0;
  static constexpr rt::Duration kSuspectAfter = std::chrono::milliseconds(60);
  static constexpr rt::Duration kReliefTime = std::chrono::milliseconds(40);
  static constexpr rt::Duration kProofTime = std::chrono::milliseconds(60);
  static constexpr rt::Duration kPatience = std::chrono::seconds(1);
  /// An older report, or one later than this after the last, proves nothing: silence is another
  /// fault.
  static constexpr rt::Duration kYoung = std::chrono::milliseconds(15);
  /// A report proves no more than this much time without a count.
  static constexpr rt::Duration kCredit = std::chrono::milliseconds(4);
  /// Counts after which a joint has moved on by itself.
  static constexpr std::int32_t kMovedOn_counts = 5;

  explicit EncoderWatch(const profiles::DeviceProfile& profile) noexcept;

  /// Looks at one cycle's report. @returns the joint (0, 1, 2) whose encoder is frozen.
  [[nodiscard]] std::optional<int> check(rt::TimePoint now,
                                         const driver::DeviceReport& report) noexcept;

  /// What part of each joint's torque may be commanded, 0..1.
  /// @param force_torque_Nm J^T F of the force that is to be rendered, all of it.
  [[nodiscard]] Eigen::Array3d relief(rt::TimePoint now, double elapsed_s,
                                      const Eigen::Vector3d& force_torque_Nm) noexcept;

  /// Nothing has been rendered for a while: all that was seen before is void.
  void restart() noexcept;

  /// How often a joint has been suspected.
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

  /// In suspicion, relieved of all its torque in good time, and still without a count.
  [[nodiscard]] bool unmoved(const Joint& joint) const noexcept;

  profiles::Axes loaded_above_Nm_;
  std::array<Joint, 3> joints_;
  std::uint64_t last_sequence_ = 0;
  rt::TimePoint last_released_{};
  rt::Duration
      watched_{};  ///< how long reports have come one soon after the other, by their credit
  std::uint64_t suspected_stuck_encoders_ = 0;
};

}  // namespace forcegrid::servo
