// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::rt {

/// While it lives, the kernel keeps all processors out of idle states from which they wake up late:
/// a request of 0 us in /dev/cpu_dma_latency, as cyclictest makes it. It costs power.
/// Source: the Linux kernel's "PM Quality Of Service Interface".
/// Real-time: no; before the first cycle and after the last. Threads: one.
class ProcessorsAwake {
 public:
  explicit ProcessorsAwake(const char* file = "/dev/cpu_dma_latency");
  ~ProcessorsAwake();
  ProcessorsAwake(const ProcessorsAwake&) = delete;
  ProcessorsAwake& operator=(const ProcessorsAwake&) = delete;

  bool held() const noexcept { return file_ >= 0; }
  /// The system's reason and the remedy where the request was refused; empty when it is held, and
  /// on kernels that take none.
  const std::string& refused() const noexcept { return refused_; }

 private:
  int file_ = -1;
  std::string refused_;
};

}  // namespace forcegrid::rt
