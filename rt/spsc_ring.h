// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace forcegrid::rt {

/// Bounded queue from one producer thread to one consumer thread. A full ring refuses the new
/// element and the producer counts it; nothing is overwritten.
/// Real-time: push and pop are wait-free; only the constructor allocates.
/// Threads: one thread pushes, one thread pops.
template <typename T>
class SpscRing {
  // Fixed-size Eigen vectors are welcome; a type that owns memory is not.
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  /// @param capacity elements it holds at most; at least 1.
  explicit SpscRing(std::size_t capacity) : slots_(capacity + 1) {}
  SpscRing(const SpscRing&) = delete;
  SpscRing& operator=(const SpscRing&) = delete;

  /// @returns false when the ring is full; the element is then not taken.
  [[nodiscard]] bool push(const T& element) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    const std::size_t next = tail + 1 == slots_.size() ? 0 : tail + 1;
    if (next == head_.load(std::memory_order_acquire)) {
      return false;
    }
    slots_[tail] = element;
    tail_.store(next, std::memory_order_release);
    return true;
  }

  /// @returns false when the ring is empty; `element` is then untouched.
  [[nodiscard]] bool pop(T& element) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) {
      return false;
    }
    element = slots_[head];
    head_.store(head + 1 == slots_.size() ? 0 : head + 1, std::memory_order_release);
    return true;
  }

 private:
  static_assert(std::atomic<std::size_t>::is_always_lock_free);
  std::vector<T> slots_;
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
};

}  // namespace forcegrid::rt
