// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

#include "driver/device.h"
#include "driver/mechanism.h"
#include "driver/wrist_limiter.h"
#include "forcegrid/core/force_method.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "rt/thread.h"
#include "servo_loop/command_limiter.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/device_button.h"
#include "servo_loop/emergency_stop.h"
#include "servo_loop/first_touch.h"
#include "servo_loop/force_renderer.h"
#include "servo_loop/method_fade.h"
#include "servo_loop/motion_guard.h"
#include "servo_loop/motor_check.h"
#include "servo_loop/sample_intake.h"
#include "servo_loop/servo_options.h"
#include "servo_loop/servo_outcome.h"
#include "servo_loop/servo_ports.h"
#include "servo_loop/tool_touch.h"
#include "servo_loop/wrist_guard.h"

namespace forcegrid::servo {
#pragma GCC visibility push(default)

/// The real-time loop: device -> kinematics -> force method -> limits -> torque -> device.
/// It owns neither the device nor the methods. Threads: may be constructed on any thread; run()
/// needs a thread for itself.
class ServoLoop {
 public:
  /// @param methods  1 to kMaxMethods, none null. The first one is rendered; the others are
  ///                 evaluated on the same path.
  /// @throws std::invalid_argument naming the option that cannot be used.
  ServoLoop(driver::Device& device, const profiles::DeviceProfile& profile,
            std::vector<ForceMethod*> methods, ServoPorts& ports, const ServoOptions& options);

  /// [bus frames] Phase of the cycles on the device's bus: the bus takes the OUT with a cycle's
  /// command this long after the cycle began. That is enough for waking up, computing and handing
  /// over, leaves the command little time to age, and has the report back before the next cycle at
  /// 500 Hz even on a bus that collects it one frame later.
  static constexpr double kBusPhase = 0.4;
  /// The deadlines follow the bus by at most this much per cycle: more than two crystals drift
  /// apart, and too little to show in the period.
  static constexpr rt::Duration kLargestShift = std::chrono::microseconds(1);

  /// Runs cycles at absolute deadlines until `stop` is true, `seconds` have passed (0: no end), or
  /// a fault. Every way out has written zero current. First requests SCHED_FIFO and locked memory
  /// for the calling thread, as the options say; the outcome reports a refusal, and the loop runs
  /// without.
  ServoOutcome run(const std::atomic<bool>& stop, double seconds) noexcept;

  /// The next run() uses `device`, the same device opened again. Earlier samples and reports are
  /// forgotten, the motors are checked again, and the force ramps in. Counts in outcomes continue.
  /// Real-time: no. Threads: not during run().
  void continue_with(driver::Device& device);

  /// One cycle, without waiting: reads, computes, commands, fills, records.
  /// @param now        when the cycle starts.
  /// @param next_read  when the next cycle will start.
  /// @returns the fault that ended the cycle at zero current, or kNone.
  /// Real-time: no allocation, lock, log or throw; bounded by the methods and the fill budget.
  Fault run_cycle(rt::TimePoint now, rt::TimePoint next_read) noexcept;

 private:
  /// Where the tool is, and whether that is plausible.
  struct SensedTool {
    driver::DeviceReport report;
    driver::ArmPose pose;
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m]
    Eigen::Vector3d touching_W = Eigen::Vector3d::Zero();  ///< [m] the coupling's end, if any
    std::array<double, 4> orientation_WT_wxyz = link::kIdentity;
    Fault fault = Fault::kNone;
  };

  // The steps of a cycle, in order.
  double begin_cycle(rt::TimePoint now, CycleRecord& record) noexcept;
  void take_settings(CycleRecord& record) noexcept;
  SensedTool sense(rt::TimePoint now) noexcept;
  Eigen::Vector3d ask_methods(rt::TimePoint now, double elapsed_s, const SensedTool& tool,
                              CycleRecord& record) noexcept;
  bool held_by_person(rt::TimePoint now) const noexcept;
  HeldBack why_held_back(rt::TimePoint now) const noexcept;
  bool has_force_to_render() const noexcept {
    return intake_.has_sample() || !options_.needs_samples;
  }
  Fault check_motors(rt::TimePoint now, const driver::DeviceReport& report,
                     const driver::ArmPose& pose) noexcept;
  ForceRenderer::Cycle cycle_to_render(rt::TimePoint now, double elapsed_s,
                                       const Eigen::Vector3d& position_W,
                                       const Eigen::Vector3d& object_force_W) noexcept;
  Eigen::Vector3d gravity_torque_Nm(double elapsed_s, const driver::ArmPose& pose) noexcept;
  std::optional<SampleIntake::ToolPose> tool_pose(const SensedTool& tool) const noexcept;
  Eigen::Vector3d tool_torque_W_Nm(const SensedTool& tool,
                                   const Eigen::Vector3d& force_W) const noexcept;
  driver::LimitedTorque limit_tool_torque(rt::TimePoint now, double elapsed_s,
                                          const SensedTool& tool,
                                          const CommandLimiter::Wanted& wanted) noexcept;
  void describe_wrist(const SensedTool& tool, CycleRecord& record) const noexcept;
  void end_cycle(rt::TimePoint now, const SensedTool& tool, CycleRecord& record) noexcept;

  bool emergency(const driver::DeviceReport& report) noexcept;
  void start_anew() noexcept;
  rt::Duration shift_to_bus_phase(rt::TimePoint deadline) noexcept;
  void add_counts(ServoOutcome& outcome) const noexcept;

  driver::Device* device_;
  profiles::DeviceProfile profile_;
  ServoOptions options_;
  std::vector<ForceMethod*> methods_;
  ServoPorts& ports_;
  std::unique_ptr<driver::Mechanism> mechanism_;
  MotionGuard guard_;
  WristGuard wrist_;
  SampleIntake intake_;
  MethodFade method_fade_;
  FirstTouch first_touch_;
  ToolTouch tool_touch_;
  MotorCheck motor_check_;
  ForceRenderer renderer_;
  CommandLimiter limiter_;
  driver::WristLimiter wrist_limiter_;
  EmergencyStop own_emergency_stop_;
  EmergencyStop* emergency_stop_;
  DeviceButton button_;
  rt::Duration bus_frame_;

  rt::TimePoint last_cycle_{};
  double wakeup_us_ = 0.0;  ///< of the current cycle, set by run()
  double gravity_gain_ = 0.0;
  /// That the methods were told last; NaN: nothing.
  double budget_reads_ = std::numeric_limits<double>::quiet_NaN();
  std::uint64_t cycle_ = 0;
  int faulty_joint_ = -1;
  bool motors_checked_ = false;
  bool first_cycle_ = true;
  std::uint64_t stalls_ = 0;
  std::uint32_t missed_before_this_ = 0;
};

#pragma GCC visibility pop
}  // namespace forcegrid::servo
