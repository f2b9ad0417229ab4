// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace forcegrid::servo {

/// What the hand feels, from best to least. The loop steps down by itself and comes back up by a
/// ramp.
enum class Rung : std::uint8_t {
  kFresh,    ///< the method's force, from samples that come on time
  kOld,      ///< the method's force, although samples are late
  kDamping,  ///< the force fades, and a DampingField takes its place
  kZero,     ///< zero current, except gravity compensation if that is on
};
inline constexpr int kRungs = 4;

#pragma GCC visibility push(default)
/// Static text, e.g. "damping field".
const char* to_string(Rung rung) noexcept;
#pragma GCC visibility pop

/// Why no force is rendered.
enum class HeldBack : std::uint8_t {
  kNot,         ///< force is rendered
  kNoSamples,   ///< no sample has come yet, or none comes any more
  kMotorCheck,  ///< MotorCheck has not passed yet
  kDeadMan,     ///< the dead-man's switch is not held
  kPaused,      ///< a person has paused it, see ServoPorts::force_paused
};

#pragma GCC visibility push(default)
/// One sentence for people: what the loop does at `rung`, and why.
std::string sentence_for(Rung rung, HeldBack held_back);
#pragma GCC visibility pop

struct LadderOptions {
  double ramp_in_s = 0.5;  ///< from no force to the whole force
  double fade_s = 0.1;     ///< from the whole force to none; also for the damping field, both ways
  /// Old samples are rendered for this long or five simulator periods, whichever is longer.
  double sample_timeout_s = 0.25;
  double damping_s = 2.0;  ///< how long the damping field lasts, from the beginning of the fade
};

/// How the force degrades as samples age. A fresh sample is at most kFreshPeriods simulator periods
/// old, an old one at most max(sample_timeout_s, kOldPeriods periods). Beyond that the force fades
/// while a damping field grows; after damping_s the damping field fades, too. From any rung the
/// force comes back within ramp_in_s. The ladder begins at kZero. Ages count from a sample's
/// arrival.
/// It has no clock: time comes as dt. Real-time: no allocation, lock or throw. Threads: one.
class DegradationLadder {
 public:
  static constexpr double kFreshPeriods = 2.0;
  static constexpr double kOldPeriods = 5.0;

  /// @throws std::invalid_argument unless all times are positive.
  explicit DegradationLadder(const LadderOptions& options);

  /// One cycle.
  /// @param dt_s [s] since the last one. @param sample_age_s [s] since the newest sample arrived;
  /// infinite: none has. @param sample_period_s [s] of the simulator, as measured.
  /// @param held_back kNot, or why there must be no force whatever the samples; the ladder itself
  /// finds kNoSamples.
  void update(double dt_s, double sample_age_s, double sample_period_s,
              HeldBack held_back) noexcept;

  /// Drops force and damping at once, as after a pause.
  void drop() noexcept;

  Rung rung() const noexcept { return rung_; }
  HeldBack held_back() const noexcept { return held_back_; }
  double force_gain() const noexcept { return force_gain_; }      ///< 0..1
  double damping_gain() const noexcept { return damping_gain_; }  ///< 0..1

 private:
  LadderOptions options_;
  Rung rung_ = Rung::kZero;
  HeldBack held_back_ = HeldBack::kNoSamples;
  double force_gain_ = 0.0;
  double damping_gain_ = 0.0;
  double damping_left_s_ = 0.0;
};

}  // namespace forcegrid::servo
