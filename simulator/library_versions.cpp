// SPDX-License-Identifier: Apache-2.0
#include "simulator/library_versions.h"

#include <zmq.hpp>

namespace forcegrid::simulator {

std::vector<std::pair<std::string, std::string>> library_versions() {
  const auto [major, minor, patch] = zmq::version();
  return {{"ZeroMQ",
           std::to_string(major) + '.' + std::to_string(minor) + '.' + std::to_string(patch)}};
}

}  // namespace forcegrid::simulator
