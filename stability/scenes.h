// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stability/scene_objects.h"
#include "stability/slow_simulator.h"

namespace forcegrid::stability {

/// A case in which methods are known or likely to fail: an object and the behaviour of its
/// simulator.
struct Scene {
  std::string name;
  std::string title;  ///< in a sentence's words
  std::function<std::unique_ptr<VirtualObject>(const BaseField&)> make;
  SimulatorFault fault = SimulatorFault::kNone;
  double noise_N = 0.0;  ///< standard deviation of white noise on each axis of the answers
};

/// Returns all scenes: first held, the simplest object; then difficult objects; then faulty
/// simulators.
const std::vector<Scene>& scenes();

/// @throws std::invalid_argument for an unknown name, listing the known ones.
const Scene& scene_of(const std::string& name);

}  // namespace forcegrid::stability
