// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bitset>
#include <cstddef>
#include <cstdint>

namespace forcegrid::link {

/// Lets each counter of one stream of datagrams pass once. A counter that has passed, or lies
/// kWindow or more behind the highest, does not pass. Counters begin at 1 and never wrap. Give it
/// counters of authenticated datagrams only, or a forger could move the window.
/// Source: RFC 4303 (IPsec ESP), section 3.4.3.
/// Real-time: bounded, no allocation, lock or throw. Threads: one.
class ReplayWindow {
 public:
  /// How far a datagram may be overtaken by others of its stream: 0.25 s at 4 kHz.
  static constexpr std::uint64_t kWindow = 1024;

  /// @returns whether `counter` passes; it does not pass a second time.
  bool pass(std::uint64_t counter) noexcept {
    if (counter > newest_) {
      const std::uint64_t step = counter - newest_;
      passed_ = step < kWindow ? passed_ << static_cast<std::size_t>(step) : Bits{};
      newest_ = counter;
      passed_.set(0);
      return true;
    }
    const std::uint64_t back = newest_ - counter;
    if (counter == 0 || back >= kWindow || passed_.test(static_cast<std::size_t>(back))) {
      return false;
    }
    passed_.set(static_cast<std::size_t>(back));
    return true;
  }

 private:
  using Bits = std::bitset<kWindow>;
  std::uint64_t newest_ = 0;
  Bits passed_;  ///< bit i: newest_ - i has passed
};

}  // namespace forcegrid::link
