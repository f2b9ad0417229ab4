// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace forcegrid::cli {

struct SimulatorWatchOptions {
  std::string address;      ///< for people
  double period_s = 0.0;    ///< [s] between samples that are on time; 0: not known
  double timeout_s = 10.0;  ///< [s] silence after which the run ends
  bool wait = false;        ///< the run waits without an end instead
  bool has_key = false;     ///< the link is encrypted
};

/// Judges from the arrival of samples whether a run has a simulator. It has no clock: times are [s]
/// on one clock.
/// Threads: one.
class SimulatorWatch {
 public:
  enum class State {
    kThere,  ///< samples come
    kNever,  ///< none has come yet
    kLost,   ///< none has come for a while
  };

  explicit SimulatorWatch(SimulatorWatchOptions options);

  /// From `now_s` on the loop runs: silence counts from here.
  void begin(double now_s) noexcept;

  /// @param sample_s  when the newest sample came; nothing: none has.
  /// @param nobody_listens  the system has reported so.
  /// @returns a line for people: that there is no sample, why, and what happens then; or that
  ///          samples come again. Nothing if there is nothing new.
  std::optional<std::string> update(double now_s, std::optional<double> sample_s,
                                    bool nobody_listens);

  /// Sentences for the summary: that there was no simulator, or how long it was silent.
  [[nodiscard]] std::vector<std::string> notes() const;
  /// Of the last update().
  [[nodiscard]] State state() const noexcept { return state_; }
  /// By the last update() the run has no simulator at its end: none has ever come, or the silence
  /// has lasted for more than two seconds, which no busy machine explains.
  [[nodiscard]] bool missing() const noexcept;
  /// The silence has lasted for `timeout_s`, and the run does not wait.
  [[nodiscard]] bool gave_up() const noexcept { return gave_up_; }

 private:
  void measure_period(double sample_s) noexcept;
  [[nodiscard]] double patience_s() const noexcept;  ///< shorter silence is normal
  [[nodiscard]] std::string silence_line(double silent_s, bool nobody_listens) const;

  SimulatorWatchOptions options_;
  double period_s_;  ///< [s] between samples, asked for or measured
  double begun_s_ = 0.0;
  double next_line_s_ = 0.0;
  State state_ = State::kNever;
  bool gave_up_ = false;
  double silent_s_ = 0.0;  ///< of the last update()
  double newest_s_ = 0.0;  ///< when the newest sample came
  int silences_ = 0;
  double longest_silence_s_ = 0.0;
};

}  // namespace forcegrid::cli
