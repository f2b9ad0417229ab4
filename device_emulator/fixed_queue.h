// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cassert>
#include <cstddef>

namespace forcegrid::emulator {

/// First in, first out, of at most N elements, without allocation.
/// Real-time: yes. Threads: one.
template <typename T, std::size_t N>
class FixedQueue {
 public:
  [[nodiscard]] std::size_t size() const noexcept { return count_; }
  [[nodiscard]] std::size_t room() const noexcept { return N - count_; }
  [[nodiscard]] bool empty() const noexcept { return count_ == 0; }
  void clear() noexcept { count_ = 0; }

  /// Not when room() is 0.
  void push(const T& value) noexcept {
    assert(count_ < N);
    elements_[(first_ + count_) % N] = value;
    ++count_;
  }
  /// Not when empty().
  T pop() noexcept {
    assert(count_ > 0);
    const T value = elements_[first_];
    first_ = (first_ + 1) % N;
    --count_;
    return value;
  }
  /// The i-th oldest; i below size().
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept {
    assert(i < count_);
    return elements_[(first_ + i) % N];
  }

 private:
  std::array<T, N> elements_{};
  std::size_t first_ = 0;
  std::size_t count_ = 0;
};

}  // namespace forcegrid::emulator
