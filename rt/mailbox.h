// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <type_traits>

namespace forcegrid::rt {

/// Hands the newest value from one writer thread to one reader thread; older unread values are
/// overwritten. A triple buffer: the writer fills a slot that is not being read, then swaps it in.
/// Real-time: publish and fetch are wait-free; no allocation, lock or throw.
/// Threads: one thread publishes, one thread fetches.
template <typename T>
class Mailbox {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  Mailbox() = default;
  Mailbox(const Mailbox&) = delete;
  Mailbox& operator=(const Mailbox&) = delete;

  void publish(const T& value) noexcept {
    slots_[write_slot_] = value;
    const std::uint32_t previous =
        shared_.exchange(write_slot_ | kFresh, std::memory_order_acq_rel);
    write_slot_ = previous & kSlotMask;
  }

  /// Copies the newest value into `value`.
  /// @returns true when it was published since the last fetch; false leaves `value` untouched.
  [[nodiscard]] bool fetch(T& value) noexcept {
    if ((shared_.load(std::memory_order_relaxed) & kFresh) == 0) {
      return false;
    }
    const std::uint32_t previous = shared_.exchange(read_slot_, std::memory_order_acq_rel);
    read_slot_ = previous & kSlotMask;
    value = slots_[read_slot_];
    return true;
  }

 private:
  static constexpr std::uint32_t kSlotMask = 3;
  static constexpr std::uint32_t kFresh = 4;
  static_assert(std::atomic<std::uint32_t>::is_always_lock_free);

  T slots_[3]{};
  alignas(64) std::atomic<std::uint32_t> shared_{0};
  alignas(64) std::uint32_t write_slot_ = 1;
  alignas(64) std::uint32_t read_slot_ = 2;
};

}  // namespace forcegrid::rt
