// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

#include <mutex>

namespace forcegrid::python {

/// Who may use an object that is made for one thread at a time, when Python's threads share it. A
/// call that takes long releases the GIL and keeps the lock; another thread's call waits for the
/// lock without the GIL. Nobody who holds the lock waits for the GIL, so neither waits for ever:
/// the calls given here must not touch Python.
class Guard {
 public:
  /// Calls call() alone. The GIL stays held unless another thread is at work.
  template <typename Call>
  auto alone(Call call) {
    std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (lock) {
      return call();
    }
    return without_gil(call);
  }

  /// The same without the GIL, for what takes long.
  template <typename Call>
  auto without_gil(Call call) {
    const pybind11::gil_scoped_release release;
    const std::lock_guard<std::mutex> lock(mutex_);
    return call();
  }

 private:
  std::mutex mutex_;
};

}  // namespace forcegrid::python
