// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "simulator/solver/dynamic_object.h"

namespace forcegrid::simulator {

/// Adapts a DynamicObject to StickyContact: holds the time that the next move advances it by.
/// Threads: one.
struct TimeSteppedObject {
  DynamicObject& object;
  double left_s = 0.0;  ///< of the next move

  int grab(const Eigen::Vector3d& point_W, double radius_m) {
    return object.grab(point_W, radius_m);
  }
  void release() noexcept { object.release(); }
  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept {
    const double duration_s = left_s;
    left_s = 0.0;
    return object.advance(duration_s, displacement_W);
  }
};

}  // namespace forcegrid::simulator
