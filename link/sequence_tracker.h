// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bitset>
#include <cstddef>
#include <cstdint>

namespace forcegrid::link {

/// How far `a` is ahead of `b` on the circle of 32-bit sequence numbers; negative when behind.
/// Source: RFC 1982 (serial number arithmetic); right for distances below 2^31.
constexpr std::int32_t ahead_of(std::uint32_t a, std::uint32_t b) noexcept {
  return static_cast<std::int32_t>(a - b);
}

/// Tells new, reordered and repeated sequence numbers apart, and counts the missing ones.
/// Real-time: bounded, no allocation, lock or throw. Threads: one.
class SequenceTracker {
 public:
  /// How far back an old number can be distinguished from a repeated one.
  static constexpr std::int32_t kWindow = 1024;

  enum class Arrival : std::uint8_t {
    kNewest,
    kReordered,   ///< older than the newest, not seen before
    kDuplicated,  ///< seen before
    kTooOld,      ///< beyond the window: reordered or repeated
  };

  Arrival observe(std::uint32_t sequence) noexcept {
    if (!started_) {
      started_ = true;
      first_ = newest_ = sequence;
      seen_.reset();
      seen_.set(0);
      return Arrival::kNewest;
    }
    const std::int32_t step = ahead_of(sequence, newest_);
    if (step > 0) {
      missing_ += static_cast<std::uint64_t>(step) - 1;
      seen_ = step < kWindow ? seen_ << static_cast<std::size_t>(step) : std::bitset<kWindow>{};
      seen_.set(0);
      newest_ = sequence;
      return Arrival::kNewest;
    }
    if (step <= -kWindow) {
      return Arrival::kTooOld;
    }
    const auto back = static_cast<std::size_t>(-step);
    if (seen_.test(back)) {
      return Arrival::kDuplicated;
    }
    seen_.set(back);
    if (ahead_of(sequence, first_) > 0) {
      --missing_;
    }
    return Arrival::kReordered;
  }

  /// The peer restarts its sequence; the earlier missing ones stay counted.
  void restart() noexcept { started_ = false; }

  /// Numbers between the first and the newest that have not arrived.
  [[nodiscard]] std::uint64_t missing() const noexcept { return missing_; }

 private:
  bool started_ = false;
  std::uint32_t first_ = 0;
  std::uint32_t newest_ = 0;
  std::bitset<kWindow> seen_;  ///< bit i: newest_ - i has arrived
  std::uint64_t missing_ = 0;
};

}  // namespace forcegrid::link
