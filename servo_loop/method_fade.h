// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>

#include "servo_loop/cycle_record.h"

namespace forcegrid::servo {

/// Fades from one method's force to another's, when a person chooses another one to be rendered.
/// The rendered force is a mean of the methods' forces with weights that move to the chosen one
/// within kFade_s, so that it never steps, also when another choice comes on the way. Real-time: no
/// allocation, lock or throw. Threads: one, the servo's.
class MethodFade {
 public:
  static constexpr double kFade_s = 0.3;

  /// One cycle. @param dt_s [s] since the last one, at least 0.
  /// @param wanted    index of the method to render; what is no index of `forces_W_N` is 0.
  /// @param forces_W_N  of each method, at least one and at most kMaxMethods.
  Eigen::Vector3d force_W(double dt_s, std::size_t wanted,
                          std::span<const Triple> forces_W_N) noexcept;

 private:
  std::array<double, kMaxMethods> share_{1.0};  ///< of each method, 0..1, together 1
};

}  // namespace forcegrid::servo
