// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>
#include <type_traits>

namespace forcegrid {

/// An array of plain values whose memory is allocated once, aligned to a cache line, without
/// exceptions. A method that could not allocate all of its memory reports it through its factory.
template <typename Value>
class Buffer {
  static_assert(std::is_trivially_copyable_v<Value> && std::is_trivially_destructible_v<Value>);

 public:
  Buffer() noexcept = default;
  /// `count` copies of `initial`, or an array that is not `allocated()`.
  Buffer(std::size_t count, const Value& initial) noexcept
      : values_(static_cast<Value*>(::operator new(std::max<std::size_t>(count, 1) * sizeof(Value),
                                                   kAlignment, std::nothrow))),
        size_(values_ == nullptr ? 0 : count),
        allocated_(values_ != nullptr) {
    std::uninitialized_fill_n(values_.get(), size_, initial);
  }

  /// False when there was not enough memory; the array is then empty.
  bool allocated() const noexcept { return allocated_; }
  std::size_t size() const noexcept { return size_; }
  std::size_t bytes() const noexcept { return size_ * sizeof(Value); }
  Value* data() noexcept { return values_.get(); }
  const Value* data() const noexcept { return values_.get(); }
  Value& operator[](std::size_t i) noexcept { return values_.get()[i]; }
  const Value& operator[](std::size_t i) const noexcept { return values_.get()[i]; }

 private:
  static constexpr std::align_val_t kAlignment{64};
  struct Free {
    void operator()(Value* values) const noexcept { ::operator delete(values, kAlignment); }
  };

  std::unique_ptr<Value, Free> values_;
  std::size_t size_ = 0;
  bool allocated_ = true;
};

}  // namespace forcegrid
