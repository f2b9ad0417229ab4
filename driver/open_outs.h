// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "driver/w2_codec.h"
#include "rt/clock.h"

namespace forcegrid::driver {

/// One report to the device, which makes it sample its counters and answer with a report.
struct Out {
  rt::TimePoint sent{};       ///< when it was handed to the transport
  rt::TimePoint completed{};  ///< when the device had taken it
  bool last_zero = false;     ///< after it no current follows
};

/// OUTs without their reports, and which one a report answers: the oldest, since reports come in
/// the order of their OUTs.
///
/// After a report that has not come in time it is in doubt which one a report answers: the missing
/// one may be lost, or on its way. Reports that come promptly after the newest OUT, several in a
/// row, answer that one, so the missing one was lost.
/// Real-time: no allocation, lock or throw. Threads: one.
class OpenOuts {
 public:
  /// A report that comes later after its OUT is late.
  static constexpr rt::Duration kPrompt = std::chrono::milliseconds(4);
  /// With reports late by as much as 100 ms three are on their way, and one of four comes late.
  static constexpr int kPromptToBelieve = 4;

  /// Where there is no room the oldest gives way; it has been waited for long enough.
  void push(const Out& out) noexcept {
    if (size_ == outs_.size()) {
      static_cast<void>(answer());
    }
    outs_[size_++] = out;
    newest_ = out;
  }
  /// A report has come. @returns false when it answers none.
  bool answer() noexcept {
    if (size_ == 0) {
      return false;
    }
    answered_ = outs_[0];
    std::copy(outs_.begin() + 1, outs_.begin() + static_cast<std::ptrdiff_t>(size_), outs_.begin());
    --size_;
    return true;
  }
  /// A report has not come in time.
  void doubt() noexcept {
    in_doubt_ = true;
    prompt_in_a_row_ = 0;
  }
  /// What has not come is lost.
  void give_up() noexcept {
    size_ = 0;
    in_doubt_ = false;
  }
  /// In doubt, a report has come at `arrived` and answer() was called.
  /// @returns false when that does not tell; then something more may be on its way.
  [[nodiscard]] bool judge(rt::TimePoint arrived) noexcept {
    if (size_ == 0) {
      give_up();
      return true;
    }
    if (arrived - newest_.completed > kPrompt) {
      return false;
    }
    if (++prompt_in_a_row_ >= kPromptToBelieve) {
      give_up();
    }
    return true;
  }

  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  [[nodiscard]] bool in_doubt() const noexcept { return in_doubt_; }
  [[nodiscard]] const Out& newest() const noexcept { return newest_; }
  /// The OUT whose report was the last to come; in doubt, the oldest that it may be.
  [[nodiscard]] const Out& answered() const noexcept { return answered_; }

 private:
  std::array<Out, 8> outs_{};
  std::size_t size_ = 0;
  Out newest_;
  Out answered_;
  bool in_doubt_ = false;
  int prompt_in_a_row_ = 0;
};

/// Notices a second program that commands the device. Each of its commands makes the device answer,
/// so reports come that answer nothing this program sent. A report that repeats the one before it
/// proves nothing: a faulty device may send a report twice. One that differs from it was sampled
/// for somebody. A few are forgiven, for a report that was given up for lost may come after all.
/// Real-time: no allocation, lock or throw. Threads: one.
class ForeignReplies {
 public:
  /// So many prove a second program, unless they are forgotten, one every kForgetOne.
  static constexpr int kProof = 5;
  static constexpr rt::Duration kForgetOne = std::chrono::seconds(10);

  /// Takes a report that answers no OUT. @returns true when a second program is proved.
  [[nodiscard]] bool take(const w2::InputReport& report, const w2::InputReport& before,
                          rt::TimePoint arrived) noexcept {
    if (report.counts == before.counts && report.calibration_button == before.calibration_button) {
      return false;
    }
    for (; seen_ > 0 && arrived - since_ >= kForgetOne; --seen_) {
      since_ += kForgetOne;
    }
    if (seen_ == 0) {
      since_ = arrived;
    }
    seen_ = std::min(seen_ + 1, kProof);
    return seen_ == kProof;
  }

 private:
  int seen_ = 0;
  rt::TimePoint since_{};  ///< none has been forgotten since
};

}  // namespace forcegrid::driver
