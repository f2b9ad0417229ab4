// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <chrono>

#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "servo_loop/cycle_listener.h"
#include "servo_loop/dead_man.h"
#include "servo_loop/emergency_stop.h"
#include "servo_loop/force_renderer.h"
#include "servo_loop/tool_touch.h"
#include "servo_loop/torque_source.h"

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// Where the workspace frame W lies in the device frame D. The axes are parallel (x toward the
/// user, y to the user's right, z up) and lengths are not scaled, so forces need no conversion.
struct WorkspaceMap {
  Eigen::Vector3d W_origin_D = Eigen::Vector3d::Zero();  ///< [m] W's origin, expressed in D

  Eigen::Vector3d position_W(const Eigen::Vector3d& position_D) const noexcept {
    return position_D - W_origin_D;
  }
};

/// Settings of a ServoLoop, fixed for its lifetime.
struct ServoOptions {
  double rate_Hz = 500.0;  ///< 100 to 4000
  /// Work that each method may do per cycle, in vertices or the method's other units; at least 1.
  int fill_budget = 1000;
  /// Expected rate of samples, until enough have arrived to measure it; above 0, at most 4000.
  double simulator_rate_Hz = 30.0;
  /// How often the rendered method may query the simulator at a position of its own choice, see
  /// ForceMethod::plan_request(). 0: never; at most once per cycle.
  double requests_per_s = 0.0;
  /// Without a new report for this long the loop ends with a fault. Keep it below the device
  /// watchdog's 500 ms.
  rt::Duration report_timeout = std::chrono::milliseconds(100);
  bool gravity_compensation = false;
  /// Gives each motor a few short pushes before the first force is rendered, see MotorCheck.
  bool check_motors = true;
  /// Looks for encoders that have stopped counting, see EncoderWatch.
  bool watch_encoders = true;
  RenderingOptions rendering;
  /// Ends the loop at zero current within one cycle. Null: only the device's button does. Must
  /// outlive the loop.
  EmergencyStop* emergency_stop = nullptr;
  /// What the user must hold for force to be rendered. With kButton the device's button is not an
  /// emergency stop: releasing it stops the force.
  DeadMan dead_man = DeadMan::kNone;
  const DeadManSignal* dead_man_signal = nullptr;  ///< for kSignal; must outlive the loop
  const ForceSwitch* force_switch = nullptr;       ///< for kSwitch; must outlive the loop
  /// False: the rendered method answers for the age of what it renders by itself, and no sample
  /// need come before or while it is rendered.
  bool needs_samples = true;
  bool realtime = true;     ///< ask for SCHED_FIFO
  bool lock_memory = true;  ///< of the whole process
  /// Wants the torque at the tool, which the ladder fades with the force. Null: the simulator's
  /// samples do, see ToolTorque. Must outlive the loop.
  const TorqueSource* torque = nullptr;
  CycleListener* listener = nullptr;  ///< told of each cycle at its end; must outlive the loop
  ToolTouchOptions tool_touch;        ///< how the tools of one program's devices touch each other
  WorkspaceMap workspace;
};

/// @throws std::invalid_argument naming the first option that is out of range, or that a device of
/// this profile cannot satisfy.
void require_usable(const ServoOptions& options, const profiles::DeviceProfile& profile);

#pragma GCC visibility pop
}  // namespace forcegrid::servo
