// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::servo {

/// Where the torque at the tool comes from, in place of the simulator's samples.
/// Real-time: an implementation neither allocates, locks nor throws. Threads: the servo's.
class TorqueSource {
 public:
  virtual ~TorqueSource() = default;
  /// [N m] Of the device on the hand, about the tip, in W, wanted at `time_s` of the servo's clock.
  [[nodiscard]] virtual Eigen::Vector3d torque_W_Nm(double time_s) const noexcept = 0;
};

}  // namespace forcegrid::servo
