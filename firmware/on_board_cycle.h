// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "driver/kinematics.h"
#include "forcegrid/core/force_method.h"

namespace forcegrid::firmware {

/// What one cycle found and does.
struct CycleResult {
  driver::ArmPose pose;
  ForceEstimate estimate;
  Eigen::Vector3d force_D = Eigen::Vector3d::Zero();  ///< [N] limited
  std::array<std::int16_t, 3> current_mA{};           ///< motors a, b, c
};

/// The servo cycle on the device's own processor: encoder counts to motor currents, with the force
/// method between. The workspace frame W is the device frame D.
///
///   P = FK(counts),  F = method(P), shortened to max_force,  tau = J^T F,  I = tau / k
///
/// A pose or a force that is not known gives zero current.
/// Real-time: bounded; nothing allocates, locks or throws. Threads: one.
class OnBoardCycle {
 public:
  /// Units of work() that a cycle gives the method after its answer.
  static constexpr int kWorkUnits = 512;

  /// @param max_force_N longest force that is rendered.
  OnBoardCycle(const driver::ArmKinematics& kinematics, double max_force_N,
               ForceMethod& method) noexcept
      : kinematics_(kinematics), max_force_N_(max_force_N), method_(method) {}

  /// @param time_s of the device's clock; rises from call to call.
  /// @param counts of the encoders a, b, c; the others are not used.
  CycleResult run(double time_s, const std::array<std::int32_t, 6>& counts) noexcept;

 private:
  const driver::ArmKinematics& kinematics_;
  double max_force_N_;
  ForceMethod& method_;
};

}  // namespace forcegrid::firmware
