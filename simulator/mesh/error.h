// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

namespace forcegrid::simulator {

/// A set-up error of the simulator: says what was wrong with which input, and what to do about it.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

/// Throws Error unless `value` is finite and > 0. @param what  e.g. "solver: max_step_m".
inline void check_positive(double value, const std::string& what) {
  if (!(value > 0.0) || !std::isfinite(value)) {
    throw Error(what + " is " + std::to_string(value) + "; it must be finite and > 0");
  }
}

}  // namespace forcegrid::simulator
