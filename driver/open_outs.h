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
    given_up_ += size_;
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

  /// OUTs whose reports were given up for lost, so far.
  [[nodiscard]] std::size_t given_up() const noexcept { return given_up_; }
  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }
  [[nodiscard]] bool in_doubt() const noexcept { return in_doubt_; }
  [[nodiscard]] const Out& newest() const noexcept { return newest_; }
  /// The OUT whose report was the last to come; in doubt, the oldest that it may be.
  [[nodiscard]] const Out& answered() const noexcept { return answered_; }

 private:
  std::array<Out, 8> outs_{};
  std::size_t size_ = 0;
  std::size_t given_up_ = 0;
  Out newest_;
  Out answered_;
  bool in_doubt_ = false;
  int prompt_in_a_row_ = 0;
};

/// Notices a second program that commands the device. Each of its commands makes the device answer,
/// so reports come that answer nothing this program sent. One that repeats the report before it
/// proves nothing: a faulty device may send a report twice. One that differs was sampled for
/// somebody. It may be for this program in two cases, in which it is expected: a report that was
/// given up for lost comes after all, or one that came twice was taken for two answers, so that the
/// second answer comes when nothing is asked any more. A few more are forgiven.
/// Real-time: no allocation, lock or throw. Threads: one.
class ForeignReplies {
 public:
  /// So many prove a second program, unless they are forgotten, one every kForgetOne.
  static constexpr int kProof = 5;
  static constexpr rt::Duration kForgetOne = std::chrono::seconds(10);
  /// An expected report comes within this time.
  static constexpr rt::Duration kExpected = std::chrono::milliseconds(50);
  static constexpr std::size_t kMostExpected = 4;

  /// Takes a report that was taken for an answer.
  void answered(const w2::InputReport& report) noexcept {
    repeated_ = report == before_;
    before_ = report;
  }

  /// So many reports may come after all.
  void expect(std::size_t count, rt::TimePoint now) noexcept {
    if (count > 0) {
      expected_ = std::min((now < expected_until_ ? expected_ : 0) + count, kMostExpected);
      expected_until_ = now + kExpected;
    }
  }

  /// Takes a report that answers no OUT. @returns true when a second program is proved.
  [[nodiscard]] bool take(const w2::InputReport& report, rt::TimePoint arrived) noexcept {
    const bool repeats = report == before_;
    const bool follows_repeat = repeated_;
    before_ = report;
    repeated_ = false;
    if (repeats || follows_repeat) {
      return false;
    }
    if (expected_ > 0 && arrived < expected_until_) {
      --expected_;
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
  w2::InputReport before_;
  bool repeated_ = false;  ///< it was taken for an answer and repeated the one before it
  std::size_t expected_ = 0;
  rt::TimePoint expected_until_{};
  int seen_ = 0;
  rt::TimePoint since_{};  ///< none has been forgotten since
};

}  // namespace forcegrid::driver
