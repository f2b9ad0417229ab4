// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <HD/hdDefines.h>

#include <array>
#include <cstddef>

namespace forcegrid::openhaptics {

/// The errors of one thread, newest first. Holds 64; of more the oldest are dropped.
/// Real-time: neither allocates, locks nor throws.
class ErrorStack {
 public:
  static constexpr std::size_t kCapacity = 64;

  constexpr ErrorStack() = default;
  void push(const HDErrorInfo& error) noexcept;
  /// The newest one, which is taken; HD_SUCCESS when there is none.
  HDErrorInfo pop() noexcept;
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  std::array<HDErrorInfo, kCapacity> errors_{};
  std::size_t next_ = 0;
  std::size_t size_ = 0;
};

/// The calling thread's own.
ErrorStack& errors_of_this_thread() noexcept;

/// For the calling thread.
/// @param internal errno, or the number of a servo::Fault; 0: nothing more to say.
void push_error(HDerror code, HHD device, int internal = 0) noexcept;

/// A sentence about an error; static, never null.
const char* error_text(HDerror code) noexcept;

}  // namespace forcegrid::openhaptics
