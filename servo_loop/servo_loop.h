#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "driver/device.h"
#include "driver/force_limiter.h"
#include "driver/mechanism.h"
#include "forcegrid/core/force_method.h"
#include "forcegrid/core/sample_gate.h"
#include "link/clock_estimate.h"
#include "link/messages.h"
#include "profiles/device_profile.h"
#include "rt/mailbox.h"
#include "rt/spsc_ring.h"
#include "rt/thread.h"
#include "servo_loop/cycle_record.h"
#include "servo_loop/dead_man.h"
#include "servo_loop/device_button.h"
#include "servo_loop/emergency_stop.h"
#include "servo_loop/encoder_watch.h"
#include "servo_loop/first_touch.h"
#include "servo_loop/force_renderer.h"
#include "servo_loop/motion_guard.h"
#include "servo_loop/motor_check.h"
#include "servo_loop/motor_warmth.h"

namespace forcegrid::servo {

/// Where the workspace W lies in the device frame D. The axes are parallel (x toward the user, y to
/// the user's right, z up) and lengths are not scaled, so forces need no conversion.
struct WorkspaceMap {
  Eigen::Vector3d W_origin_D = Eigen::Vector3d::Zero();  ///< [m] W's origin, expressed in D

  Eigen::Vector3d position_W(const Eigen::Vector3d& position_D) const noexcept {
    return position_D - W_origin_D;
  }
};

struct ServoOptions {
  double rate_Hz = 500.0;  ///< 100 to 4000
  /// Vertices (or other units of a method's work) a cycle and method.
  int fill_budget = 1000;
  double simulator_rate_Hz = 30.0;
  /// How often a second the rendered method may ask the simulator for a force at a position of its
  /// own choice, see ForceMethod::plan_request(); 0: never. At most once a cycle.
  double requests_per_s = 0.0;
  /// No new report of the device for this long is a fault; less than its watchdog's 500 ms.
  rt::Duration report_timeout = std::chrono::milliseconds(100);
  bool gravity_compensation = false;
  /// Each motor gives a few short pushes before the first force is rendered: see MotorCheck.
  bool check_motors = true;
  /// Encoders that don't count are looked for: see EncoderWatch.
  bool watch_encoders = true;
  RenderingOptions rendering;
  /// Ends the loop at zero current, within a cycle; null: only the device's button does. Outlives
  /// the loop.
  EmergencyStop* emergency_stop = nullptr;
  /// What has to be held for force to be rendered. With kButton the device's button is no emergency
  /// stop: to let go of it stops the force.
  DeadMan dead_man = DeadMan::kNone;
  const DeadManSignal* dead_man_signal = nullptr;  ///< of kSignal; outlives the loop
  WorkspaceMap workspace;
};

/// A simulator's answer on its way from the link thread to the servo.
struct ArrivedSample {
  Sample sample;
  bool in_contact = false;
  rt::TimePoint arrived{};
};

/// What the loop exchanges with other threads, all of it lock-free. The loop pops `samples`,
/// pushes `records` and `queries`, fetches `surface` and publishes `tool`.
struct ServoPorts {
  rt::SpscRing<ArrivedSample> samples{64};
  rt::SpscRing<CycleRecord> records{8192};
  rt::SpscRing<link::Query> queries{64};
  rt::Mailbox<link::ToolState> tool;
  rt::Mailbox<NearSurface> surface;  ///< what the tool may touch next
  /// From the link to telemetry: the simulator's clock, where the link can tell.
  rt::Mailbox<link::ClockEstimate> simulator_clock;
  std::atomic<std::uint64_t> records_lost{0};  ///< records that found the ring full
};

struct ServoOutcome {
  Fault fault = Fault::kNone;
  int joint = -1;  ///< 0, 1, 2 where the fault is one joint's; else negative
  EmergencySource emergency = EmergencySource::kNone;  ///< of Fault::kEmergencyStop
  std::string device_failure;                          ///< the device's own words, if it had any
  std::uint64_t cycles = 0;
  std::uint64_t missed_deadlines = 0;
  /// Pauses longer than 50 ms, after which the force ramps in anew.
  std::uint64_t stalls = 0;
  std::uint64_t requests_made = 0;    ///< of the rendered method, handed to the link
  std::uint64_t answers_taken = 0;    ///< to these, given to the method
  std::uint64_t samples_refused = 0;  ///< by SampleGate
  FirstTouch::Counts first_touches;
  /// How often a joint stood still under load until its torque was led off: see EncoderWatch.
  std::uint64_t suspected_stuck_encoders = 0;
  double energy_to_hand_J = 0.0;          ///< by the rendered force, over the whole run
  double largest_energy_to_hand_J = 0.0;  ///< in any one contact, at any time
  double damped_energy_J = 0.0;           ///< by the passivity guard
  std::uint64_t cycles_damped = 0;        ///< by it
  std::uint64_t cycles_shortened = 0;     ///< whose force it shortened
  rt::Scheduling scheduling;
  std::string memory_lock_refused;  ///< empty when memory is locked
  std::string awake_refused;        ///< see rt::ProcessorsAwake
  bool zero_current_delivered = false;
};

/// [s] The servo's clock as methods and samples state it.
inline double servo_time_s(rt::TimePoint time) noexcept {
  return rt::seconds(time.time_since_epoch());
}

/// The real-time loop: device -> kinematics -> force method -> limits -> torque -> device.
/// It owns neither devices nor methods. Threads: constructed anywhere; run() on a thread of its
/// own.
class ServoLoop {
 public:
  /// @param methods the first is rendered, the others run in its shadow; 1 to kMaxMethods,
  /// non-null.
  /// @throws std::invalid_argument naming the option that can't be used.
  ServoLoop(driver::Device& device, const profiles::DeviceProfile& profile,
            std::vector<ForceMethod*> methods, ServoPorts& ports, const ServoOptions& options);

  /// [bus frames] Where in the device's bus frame the cycles begin: the OUT that carries a cycle's
  /// command is taken this long after the cycle began. Enough for waking up, computing and handing
  /// over; little of it is left to age, and the report is back before the next cycle at 500 Hz even
  /// on a bus that collects it one frame later.
  static constexpr double kBusPhase = 0.4;
  /// The raster of deadlines follows the bus by at most this much a cycle, which is more than two
  /// crystals drift apart and too little to be seen in the period.
  static constexpr rt::Duration kLargestShift = std::chrono::microseconds(1);

  /// Runs cycles at absolute deadlines until `stop` is true, `seconds` have passed (0: no end), or
  /// a fault. Every way out has written zero current. Asks for SCHED_FIFO and locked memory on the
  /// calling thread first; a refusal is reported in the outcome and the loop goes on without.
  ServoOutcome run(const std::atomic<bool>& stop, double seconds) noexcept;

  /// Goes on with `device`, the same one opened again, in the next run(): nothing of the last one
  /// is believed, the motors are checked again, and the force ramps in. Counts in outcomes go on.
  /// Real-time: no. Threads: not during run().
  void continue_with(driver::Device& device);

  /// One cycle, without waiting: reads, computes, commands, fills, records.
  /// @param now the cycle's start. @param next_read when the next cycle will start.
  /// Real-time: no allocation, lock, log or throw; bounded by methods and budget.
  Fault run_cycle(rt::TimePoint now, rt::TimePoint next_read) noexcept;

 private:
  /// Where the tool is, and whether that can be believed.
  struct SensedTool {
    driver::DeviceReport report;
    driver::ArmPose pose;
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
    Eigen::Vector3d touching_W = Eigen::Vector3d::Zero();  ///< the coupling's end, if there is one
    Fault fault = Fault::kNone;
  };

  // The steps of a cycle, in their order.
  double begin_cycle(rt::TimePoint now, CycleRecord& record) noexcept;
  SensedTool sense(rt::TimePoint now) noexcept;
  void ask_methods(rt::TimePoint now, const Eigen::Vector3d& touching_W,
                   CycleRecord& record) noexcept;
  Eigen::Vector3d gravity_torque_Nm(double elapsed_s, const driver::ArmPose& pose) noexcept;
  void end_cycle(rt::TimePoint now, const SensedTool& tool, CycleRecord& record) noexcept;

  void take_samples(rt::TimePoint now) noexcept;
  void take_contact(const ArrivedSample& arrived) noexcept;
  void take_answer(const ArrivedSample& answer) noexcept;
  void make_request(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept;
  void start_anew() noexcept;
  void cool(double elapsed_s, driver::LimitedForce& limited) noexcept;
  bool emergency(const driver::DeviceReport& report) noexcept;
  HeldBack why_held_back(rt::TimePoint now) const noexcept;
  Fault check_motors(rt::TimePoint now, const driver::DeviceReport& report,
                     const driver::ArmPose& pose) noexcept;
  void relieve(rt::TimePoint now, double elapsed_s, const Eigen::Vector3d& force_torque_Nm,
               driver::MotorCommand& command) noexcept;
  rt::Duration shift_to_bus_phase(rt::TimePoint deadline) noexcept;
  void send_tool_state(rt::TimePoint now, const Eigen::Vector3d& position_W) noexcept;
  ForceRenderer::Cycle cycle_to_render(rt::TimePoint now, double elapsed_s,
                                       const Eigen::Vector3d& position_W,
                                       const Eigen::Vector3d& felt_force_W) noexcept;

  driver::Device* device_;
  profiles::DeviceProfile profile_;
  std::unique_ptr<driver::Mechanism> mechanism_;
  driver::ForceLimiter limiter_;
  MotionGuard guard_;
  EncoderWatch encoder_watch_;
  FirstTouch first_touch_;
  MotorCheck motor_check_;
  ForceRenderer renderer_;
  MotorWarmth warmth_;
  std::array<double, 3> last_current_A_{};
  EmergencyStop own_emergency_stop_;
  EmergencyStop* emergency_stop_;
  DeviceButton button_;
  std::vector<ForceMethod*> methods_;
  ServoPorts& ports_;
  ServoOptions options_;
  rt::Duration bus_frame_;

  rt::TimePoint last_cycle_{};
  SampleGate gate_;
  rt::TimePoint newest_arrival_{};         ///< of any sample
  rt::TimePoint newest_sample_arrived_{};  ///< of one that was believed
  double newest_sample_time_s_ = 0.0;
  double sample_period_s_;
  double wakeup_us_ = 0.0;  ///< of the cycle that runs, by run()
  bool has_sample_ = false;
  bool contact_known_ = false;
  bool in_contact_ = false;
  std::uint32_t contact_epoch_ = 0;
  std::optional<std::uint32_t> air_epoch_;  ///< of the newest sample out of contact
  bool contact_expected_ = false;           ///< at expected_point_W_, as the simulator says
  Eigen::Vector3d expected_point_W_ = Eigen::Vector3d::Zero();
  bool asks_before_contact_ = false;
  std::uint64_t samples_taken_ = 0;
  rt::TimePoint next_request_{};
  std::uint32_t last_query_id_ = 0;
  std::uint64_t requests_made_ = 0;
  std::uint64_t answers_taken_ = 0;
  double gravity_gain_ = 0.0;
  std::uint32_t tool_sequence_ = 0;
  std::uint64_t cycle_ = 0;
  int faulty_joint_ = -1;
  bool motors_checked_ = false;
  bool first_cycle_ = true;
  std::uint64_t stalls_ = 0;
  std::uint32_t missed_before_this_ = 0;
};

}  // namespace forcegrid::servo
