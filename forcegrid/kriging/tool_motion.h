// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::kriging {

/// Where the tool is, how fast it moves, and how often the simulator answers.
///
///   v <- v + dt / (dt + 10 ms) (dP/dt - v)        at each observation
///   T <- T + 0.2 (interval - T)                   at each sample, interval within 1 to 200 ms
///
/// W is the workspace frame. Real-time: nothing allocates, locks or throws. Threads: one.
class ToolMotion {
 public:
  /// Takes the tool's time [s] and position [m] once per servo cycle. After a gap of 0.1 s or more
  /// the velocity starts at zero.
  /// @returns false, with everything unchanged, if a value is not finite.
  bool observe(double time_s, const Eigen::Vector3d& position_W) noexcept;

  /// Call when a sample of the tool's path arrives: measures the sample period. No effect before
  /// the first observation.
  void sample_arrived() noexcept;

  bool observed() const noexcept { return observed_; }
  double time_s() const noexcept { return time_s_; }  ///< of the newest observation
  const Eigen::Vector3d& position_W() const noexcept { return position_W_; }
  const Eigen::Vector3d& velocity_W() const noexcept { return velocity_W_; }  ///< [m/s]
  /// 1/30 s until samples have shown otherwise.
  double sample_period_s() const noexcept { return sample_period_s_; }

 private:
  bool observed_ = false;
  double time_s_ = 0.0;
  Eigen::Vector3d position_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_W_ = Eigen::Vector3d::Zero();
  double last_arrival_s_ = -1e300;
  double sample_period_s_ = 1.0 / 30.0;
};

}  // namespace forcegrid::kriging
