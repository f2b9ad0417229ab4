// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace forcegrid::testing {

/// Counts the calling thread's heap allocations while it lives. malloc, calloc, realloc and
/// aligned_alloc are replaced in programs that link allocation_count.cpp, so operator new, Eigen
/// and the C library are all seen. Not for sanitized builds, which replace malloc themselves.
class AllocationCount {
 public:
  AllocationCount() noexcept;
  std::uint64_t value() const noexcept;

 private:
  std::uint64_t start_;
};

}  // namespace forcegrid::testing
