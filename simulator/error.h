#pragma once

#include <stdexcept>
#include <string>

namespace forcegrid::simulator {

/// A set-up error of the simulator: says what was wrong with which input, and what to do about it.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

}  // namespace forcegrid::simulator
