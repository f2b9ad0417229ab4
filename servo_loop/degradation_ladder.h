#pragma once

#include <cstdint>
#include <string>

namespace forcegrid::servo {

/// What the hand feels, from best to least. A loop only ever steps down by itself, and back up by a
/// ramp.
enum class Rung : std::uint8_t {
  kFresh,    ///< the method's force, from samples that come on time
  kOld,      ///< the method's force, although samples are late
  kDamping,  ///< the force fades, and a DampingField takes its place
  kZero,     ///< nothing: zero current, but for what carries the links where that was asked for
};
inline constexpr int kRungs = 4;

/// Static text, e.g. "damping field".
const char* to_string(Rung rung) noexcept;

/// Why no force is rendered.
enum class HeldBack : std::uint8_t {
  kNot,         ///< it is
  kNoSamples,   ///< none has come yet, or none any more
  kMotorCheck,  ///< the motors are not known to be right yet
  kDeadMan,     ///< nobody holds the switch that the force depends on
};

/// One sentence for people about a loop that has come to `rung`.
std::string sentence_for(Rung rung, HeldBack held_back);

struct LadderOptions {
  double ramp_in_s = 0.5;  ///< from no force to all of it
  double fade_s = 0.1;     ///< from all of it to none; the damping field comes and goes so fast too
  /// The force of old samples goes on for this long or five simulator periods, whichever is longer.
  double sample_timeout_s = 0.25;
  double damping_s = 2.0;  ///< how long the damping field lasts, from the beginning of the fade
};

/// The ladder of degradation, as times: a fresh sample is at most kFreshPeriods simulator periods
/// old, an old one at most max(sample_timeout_s, kOldPeriods periods); then the force fades while a
/// damping field grows, and after damping_s that fades, too. The force comes back by ramp_in_s from
/// any rung. It begins at kZero. Ages are counted from a sample's arrival.
/// Pure: time comes as dt. Real-time: no allocation, lock or throw. Threads: one.
class DegradationLadder {
 public:
  static constexpr double kFreshPeriods = 2.0;
  static constexpr double kOldPeriods = 5.0;

  /// @throws std::invalid_argument unless all times are positive.
  explicit DegradationLadder(const LadderOptions& options);

  /// One cycle.
  /// @param dt_s [s] since the last one. @param sample_age_s [s] since the newest sample arrived;
  /// infinite: none has. @param sample_period_s [s] of the simulator, as measured.
  /// @param held_back kNot, or why there is to be no force whatever the samples; kNoSamples is
  /// found here.
  void update(double dt_s, double sample_age_s, double sample_period_s,
              HeldBack held_back) noexcept;

  /// At once no force and no damping, as after a pause.
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
