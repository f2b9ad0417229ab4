// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <mutex>
#include <sstream>
#include <string>

namespace forcegrid {

/// The buffer of a stream that one thread writes to and flushes while others read what it has
/// flushed.
class FlushedText final : public std::stringbuf {
 public:
  int sync() override {
    const std::lock_guard lock(mutex_);
    flushed_ = str();
    return 0;
  }
  std::string flushed() {
    const std::lock_guard lock(mutex_);
    return flushed_;
  }

 private:
  std::mutex mutex_;
  std::string flushed_;
};

}  // namespace forcegrid
