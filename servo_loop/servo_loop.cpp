// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/servo_loop.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <stdexcept>
#include <utility>

#include "driver/gimbal_kinematics.h"
#include "rt/processors_awake.h"
#include "rt/vectors.h"

namespace forcegrid::servo {
namespace {

// The device's I/O thread sends zero current after 50 ms without a command, so the force ramps in
// again after a longer pause.
constexpr rt::Duration kStall = std::chrono::milliseconds(50);

// Where ForceRenderer renders a force.
bool in_box(const profiles::DeviceProfile& profile, const Eigen::Vector3d& position_D) noexcept {
  const auto& limits = profile.limits;
  return (position_D.array() >= rt::to_vector(limits.workspace_min_m).array()).all() &&
         (position_D.array() <= rt::to_vector(limits.workspace_max_m).array()).all();
}

double to_us(rt::Duration duration) noexcept { return 1e6 * rt::seconds(duration); }

const ServoOptions& usable(const ServoOptions& options, const profiles::DeviceProfile& profile) {
  require_usable(options, profile);
  return options;
}

std::vector<ForceMethod*> usable(std::vector<ForceMethod*> methods) {
  if (methods.empty() || methods.size() > kMaxMethods ||
      std::count(methods.begin(), methods.end(), nullptr) > 0) {
    throw std::invalid_argument("servo loop: give it 1 to 4 methods");
  }
  return methods;
}

}  // namespace

ServoLoop::ServoLoop(driver::Device& device, const profiles::DeviceProfile& profile,
                     std::vector<ForceMethod*> methods, ServoPorts& ports,
                     const ServoOptions& options)
    : device_(&device),
      profile_(profile),
      options_(usable(options, profile)),
      methods_(usable(std::move(methods))),
      ports_(ports),
      mechanism_(driver::make_mechanism(profile)),
      guard_(profile, options.report_timeout),
      wrist_(profile),
      intake_(ports, methods_,
              {.max_force_N = profile.limits.max_force_N,
               .simulator_rate_Hz = options.simulator_rate_Hz,
               .requests_per_s = options.requests_per_s}),
      first_touch_(profile.limits.max_force_N),
      tool_touch_(options.tool_touch),
      motor_check_(profile, rt::from_seconds(1.0 / options.rate_Hz)),
      renderer_(profile, options.rendering),
      limiter_(profile, options.watch_encoders),
      wrist_limiter_(profile),
      emergency_stop_(options.emergency_stop != nullptr ? options.emergency_stop
                                                        : &own_emergency_stop_),
      button_(profile),
      bus_frame_(std::chrono::microseconds(profile.usb.frame_period_us)) {}

Fault ServoLoop::run_cycle(rt::TimePoint now, rt::TimePoint next_read) noexcept {
  CycleRecord record;
  const double elapsed_s = begin_cycle(now, record);
  take_settings(record);

  // Encoder report -> counts -> joint angles -> tool, believed only if plausible.
  const SensedTool tool = sense(now);
  Fault fault = tool.fault;
  if (fault == Fault::kNone) {
    intake_.send_tool_state(now, tool.touching_W, guard_.velocity_D(), tool_pose(tool));
  }

  // What the simulator has said since the last cycle, and the force there from each method.
  intake_.take(now, first_touch_);
  const Eigen::Vector3d method_force_W = ask_methods(now, elapsed_s, tool, record);

  // Until the simulator answers a new touch, the loop's own copy of the surface gives the force.
  const Eigen::Vector3d object_force_W =
      first_touch_.force_W(servo_time_s(now), tool.touching_W, method_force_W);

  // What other devices' tools push this one with, which know it where it is plausible alone.
  Eigen::Vector3d tool_force_W = Eigen::Vector3d::Zero();
  if (fault == Fault::kNone) {
    const double gain =
        in_box(profile_, tool.pose.position_D) ? renderer_.ladder().force_gain() : 0.0;
    tool_force_W = tool_touch_.force_W(now, elapsed_s, tool.position_W, gain);
  }

  // No force is rendered before the motors are known to push the right way.
  const HeldBack held_back = why_held_back(now);
  if (held_back == HeldBack::kDeadMan || held_back == HeldBack::kPaused) {
    motor_check_.restart();
  } else if (fault == Fault::kNone && held_back == HeldBack::kMotorCheck && has_force_to_render()) {
    fault = check_motors(now, tool.report, tool.pose);
  }

  if (held_back == HeldBack::kDeadMan && options_.dead_man == DeadMan::kSwitch) {
    renderer_.drop();  // off is off: no fade, and no slew limit on the way down
    limiter_.restart();
    wrist_limiter_.reset();
  }

  // Ramp, fade, workspace bound, passivity.
  CommandLimiter::Wanted wanted;
  ForceRenderer::Cycle to_render = cycle_to_render(now, elapsed_s, tool.position_W, object_force_W);
  to_render.tool_force_W = tool_force_W;
  wanted.force_D = renderer_.force(to_render, tool.pose);
  wanted.extra_torque_Nm = gravity_torque_Nm(elapsed_s, tool.pose) + motor_check_.joint_torque_Nm();
  wanted.zero = fault != Fault::kNone;
  const driver::LimitedTorque torque = limit_tool_torque(now, elapsed_s, tool, wanted);
  wanted.extra_torque_Nm += torque.arm_torque_Nm;

  // Every limit of the profile, torque to current, warm motors, stuck encoders.
  const driver::LimitedForce limited = limiter_.apply(now, elapsed_s, wanted, tool.pose);
  if (fault == Fault::kNone && (limited.acted & driver::kLimitNotFinite) != 0) {
    fault = Fault::kNotFinite;
  }

  // Out it goes; a fault commands zero.
  driver::MotorCommand command;
  command.next_read = next_read;
  command.current_A = limited.current_A;
  command.joint_torque_Nm = rt::to_array(limited.joint_torque_Nm);
  // The limits of the arm's joints shorten force and torque alike.
  const double torque_scale = fault == Fault::kNone ? limited.torque_scale : 0.0;
  const std::array<double, 3> wrist_push_A = motor_check_.wrist_current_A();
  for (std::size_t i = 0; i < 3; ++i) {
    command.wrist_current_A[i] = torque_scale * (torque.current_A[i] + wrist_push_A[i]);
  }
  device_->command(command);
  renderer_.set_rendered(limited.torque_scale * limited.force_D);
  tool_touch_.set_share(renderer_.tool_force_share());

  if (fault == Fault::kNone) {
    intake_.query_if_due(now, tool.touching_W);
  }

  // What the budget leaves goes into filling.
  for (ForceMethod* method : methods_) {
    method->work(options_.fill_budget);
  }

  if (tool.pose.has_orientation && fault == Fault::kNone) {
    record.tool_torque_W_Nm = rt::to_array(
        wrist_limiter_.drives() ? Eigen::Vector3d(torque_scale * torque.torque_D_Nm)
                                : tool_torque_W_Nm(tool, limited.torque_scale * limited.force_D));
  }
  record.tool_force_W_N = rt::to_array(tool_force_W);
  record.commanded_force_D_N = rt::to_array(limited.force_D);
  record.current_A = command.current_A;
  record.wrist_current_A = command.wrist_current_A;
  record.limits_acted = limited.acted | torque.acted;
  record.fault = fault;
  end_cycle(now, tool, record);
  return fault;
}

// Returns the time since the last cycle [s].
double ServoLoop::begin_cycle(rt::TimePoint now, CycleRecord& record) noexcept {
  record.cycle = cycle_++;
  record.time_ns = now.time_since_epoch().count();
  record.missed_deadlines = missed_before_this_;
  double elapsed_s = first_cycle_ ? 0.0 : rt::seconds(now - last_cycle_);
  first_cycle_ = false;
  record.period_us = 1e6 * elapsed_s;
  record.wakeup_us = wakeup_us_;
  last_cycle_ = now;
  if (rt::from_seconds(elapsed_s) > kStall) {
    start_anew();
    elapsed_s = 0.0;  // nothing was rendered meanwhile, so no force may have grown
  }
  return elapsed_s;
}

// What another thread has changed since the last cycle. Neither changes a force at once: requests
// bring other samples, and a budget, other times of work.
void ServoLoop::take_settings(CycleRecord& record) noexcept {
  const double requests_per_s = ports_.requests_per_s.load(std::memory_order_relaxed);
  if (requests_per_s >= 0.0) {
    intake_.set_requests_per_s(std::min(requests_per_s, options_.rate_Hz));
  }
  const double budget_reads = ports_.budget_reads.load(std::memory_order_relaxed);
  if (budget_reads > 0.0 && budget_reads != budget_reads_) {
    budget_reads_ = budget_reads;
    for (ForceMethod* method : methods_) {
      method->set_budget(budget_reads);
    }
  }
  record.budget_reads = budget_reads_;
}

ServoLoop::SensedTool ServoLoop::sense(rt::TimePoint now) noexcept {
  SensedTool tool;
  tool.report = device_->newest_report();
  tool.pose = mechanism_->forward(tool.report.counts);
  tool.fault = guard_.check(now, device_->health(), tool.report, tool.pose);
  faulty_joint_ = guard_.joint();
  // A wrist's counter that jumps beyond the stops is a jump, not a bad pose of the arm.
  if (tool.fault == Fault::kNone || tool.fault == Fault::kBadPose) {
    if (const Fault wrist = wrist_.check(tool.report, tool.pose); wrist != Fault::kNone) {
      tool.fault = wrist;
      faulty_joint_ = wrist_.encoder();
    }
  }
  if (tool.fault == Fault::kNone) {
    if (const auto joint = limiter_.stuck_encoder(now, tool.report)) {
      tool.fault = Fault::kFrozenEncoder;
      faulty_joint_ = *joint;
    }
  }
  if (emergency(tool.report)) {
    tool.fault = Fault::kEmergencyStop;
  }
  tool.position_W = options_.workspace.position_W(tool.pose.position_D);
  tool.touching_W = renderer_.touching_W(tool.position_W);
  if (tool.pose.has_orientation) {
    tool.orientation_WT_wxyz = driver::quaternion_wxyz(tool.pose.rotation_DT);  // W || D
  }
  return tool;
}

// Returns the force of the method that is rendered.
Eigen::Vector3d ServoLoop::ask_methods(rt::TimePoint now, double elapsed_s, const SensedTool& tool,
                                       CycleRecord& record) noexcept {
  const double time_s = servo_time_s(now);
  const Eigen::Vector3d& touching_W = tool.touching_W;
  for (std::size_t i = 0; i < methods_.size(); ++i) {
    if (tool.fault == Fault::kNone) {  // else the tool may be elsewhere
      methods_[i]->observe(time_s, touching_W);
    }
    if (intake_.expected_contact_W()) {
      methods_[i]->expect_contact(time_s, *intake_.expected_contact_W());
    }
    const ForceEstimate estimate = methods_[i]->force(time_s, touching_W);
    record.method_force_W_N[i] = rt::to_array(estimate.force_W);
    record.method_status[i] = estimate.status;
    record.method_uncertainty_N[i] = estimate.uncertainty_N;
    if (i == 0) {
      record.rendered_candidate = estimate.candidate;
      record.rendered_reason = estimate.reason;
    }
  }
  record.rendered_method = ports_.rendered_method.load(std::memory_order_relaxed);
  return method_fade_.force_W(elapsed_s, record.rendered_method,
                              std::span(record.method_force_W_N).first(methods_.size()));
}

// The torque that carries the links, ramped in as the force is.
Eigen::Vector3d ServoLoop::gravity_torque_Nm(double elapsed_s,
                                             const driver::ArmPose& pose) noexcept {
  gravity_gain_ = std::min(gravity_gain_ + elapsed_s / options_.rendering.ladder.ramp_in_s, 1.0);
  if (!options_.gravity_compensation) {
    return Eigen::Vector3d::Zero();
  }
  return gravity_gain_ * mechanism_->gravity_torque(pose.joint_angle_rad);
}

void ServoLoop::end_cycle(rt::TimePoint now, const SensedTool& tool, CycleRecord& record) noexcept {
  record.report_age_us = to_us(now - tool.report.released);
  record.report_sequence = tool.report.sequence;
  record.counts = {tool.report.counts[0], tool.report.counts[1], tool.report.counts[2]};
  record.position_W_m = rt::to_array(tool.position_W);
  record.touching_W_m = rt::to_array(tool.touching_W);
  record.velocity_W_m_per_s = rt::to_array(guard_.velocity_D());
  describe_wrist(tool, record);
  renderer_.describe(record);
  intake_.describe(now, record);
  record.motor_warmth = limiter_.warmest_motor();
  if (options_.listener != nullptr) {
    options_.listener->cycle_ended(record, tool.report, tool.pose);
  }
  record.compute_us = to_us(rt::Clock::now() - now);
  if (!ports_.records.push(record)) {
    ports_.records_lost.fetch_add(1, std::memory_order_relaxed);
  }
}

// What a simulator is told of a wrist.
std::optional<SampleIntake::ToolPose> ServoLoop::tool_pose(const SensedTool& tool) const noexcept {
  if (!tool.pose.has_orientation) {
    return std::nullopt;
  }
  return SampleIntake::ToolPose{.orientation_WT_wxyz = tool.orientation_WT_wxyz,
                                .angular_velocity_W_rad_per_s = wrist_.angular_velocity_D(),
                                .has_buttons = profile_.gimbal.stylus_button,
                                .buttons = tool.report.buttons};
}

Eigen::Vector3d ServoLoop::tool_torque_W_Nm(const SensedTool& tool,
                                            const Eigen::Vector3d& force_W) const noexcept {
  const auto& [w, x, y, z] = tool.orientation_WT_wxyz;
  return intake_.tool_torque().torque_W_Nm(tool.touching_W, Eigen::Quaterniond(w, x, y, z), force_W,
                                           renderer_.ladder().force_gain());
}

// What the motors of a wrist may exert: nothing with a fault, outside of the workspace, without
// force, or while an encoder that tells where they push may be wrong.
driver::LimitedTorque ServoLoop::limit_tool_torque(rt::TimePoint now, double elapsed_s,
                                                   const SensedTool& tool,
                                                   const CommandLimiter::Wanted& wanted) noexcept {
  if (!wrist_limiter_.drives() || wanted.zero || wrist_.suspected() != 0 ||
      !renderer_.in_workspace(tool.pose) || renderer_.ladder().force_gain() <= 0.0) {
    wrist_limiter_.reset();
    return {};
  }
  const Eigen::Vector3d torque_W =
      options_.torque != nullptr ? Eigen::Vector3d(renderer_.ladder().force_gain() *
                                                   options_.torque->torque_W_Nm(servo_time_s(now)))
                                 : tool_torque_W_Nm(tool, wanted.force_D);
  return wrist_limiter_.apply(torque_W, tool.pose, elapsed_s);
}

void ServoLoop::describe_wrist(const SensedTool& tool, CycleRecord& record) const noexcept {
  record.buttons = tool.report.buttons;
  if (!tool.pose.has_orientation) {
    return;
  }
  const auto& counts = tool.report.counts;
  record.has_orientation = true;
  record.suspected_wrist_encoders = wrist_.suspected();
  record.gimbal_counts = {counts[3], counts[4], counts[5]};
  record.gimbal_angle_rad = rt::to_array(tool.pose.gimbal_angle_rad);
  record.orientation_WT_wxyz = tool.orientation_WT_wxyz;
  record.angular_velocity_W_rad_per_s = rt::to_array(wrist_.angular_velocity_D());
}

bool ServoLoop::emergency(const driver::DeviceReport& report) noexcept {
  button_.update(report);
  if (button_.pressed() && options_.dead_man != DeadMan::kButton &&
      options_.dead_man != DeadMan::kSwitch) {
    emergency_stop_->press(EmergencySource::kDeviceButton);
  }
  return emergency_stop_->pressed();
}

bool ServoLoop::held_by_person(rt::TimePoint now) const noexcept {
  switch (options_.dead_man) {
    case DeadMan::kNone:
      return true;
    case DeadMan::kButton:
      return button_.held();
    case DeadMan::kSignal:
      return options_.dead_man_signal->held(now);
    case DeadMan::kSwitch:
      return options_.force_switch->on();
  }
  return false;
}

HeldBack ServoLoop::why_held_back(rt::TimePoint now) const noexcept {
  if (!held_by_person(now)) {
    return HeldBack::kDeadMan;
  }
  if (ports_.force_paused.load(std::memory_order_relaxed)) {
    return HeldBack::kPaused;
  }
  return options_.check_motors && !motors_checked_ ? HeldBack::kMotorCheck : HeldBack::kNot;
}

ForceRenderer::Cycle ServoLoop::cycle_to_render(rt::TimePoint now, double elapsed_s,
                                                const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& object_force_W) noexcept {
  ForceRenderer::Cycle cycle;
  cycle.elapsed_s = elapsed_s;
  cycle.position_W = position_W;
  cycle.velocity_W = guard_.velocity_D();
  cycle.method_force_W = object_force_W;
  cycle.sample_age_s = options_.needs_samples ? intake_.sample_age_s(now) : 0.0;
  cycle.sample_period_s = intake_.sample_period_s();
  cycle.held_back = why_held_back(now);
  cycle.in_contact = intake_.in_contact() || first_touch_.acting();
  return cycle;
}

Fault ServoLoop::check_motors(rt::TimePoint now, const driver::DeviceReport& report,
                              const driver::ArmPose& pose) noexcept {
  const MotorCheck::Verdict verdict = motor_check_.update(now, report, pose);
  motors_checked_ = verdict == MotorCheck::Verdict::kPassed;
  switch (verdict) {
    case MotorCheck::Verdict::kRunning:
    case MotorCheck::Verdict::kPassed:
      return Fault::kNone;
    case MotorCheck::Verdict::kWrongWay:
      faulty_joint_ = motor_check_.joint();
      return Fault::kMotorWrongWay;
    case MotorCheck::Verdict::kNoAnswer:
      break;
  }
  faulty_joint_ = motor_check_.joint();
  return Fault::kMotorNoAnswer;
}

void ServoLoop::continue_with(driver::Device& device) {
  device_ = &device;
  guard_ = MotionGuard(profile_, options_.report_timeout);
  wrist_ = WristGuard(profile_);
  limiter_.restart();
  wrist_limiter_.reset();
  button_.restart();
  motor_check_ = MotorCheck(profile_, rt::from_seconds(1.0 / options_.rate_Hz));
  motors_checked_ = false;
  first_touch_.forget();
  intake_.restart();
  renderer_.drop();
  gravity_gain_ = 0.0;
  faulty_joint_ = -1;
  missed_before_this_ = 0;
  first_cycle_ = true;
}

void ServoLoop::start_anew() noexcept {
  ++stalls_;
  limiter_.restart();
  wrist_limiter_.reset();
  motor_check_.restart();
  first_touch_.forget();
  renderer_.drop();
  gravity_gain_ = 0.0;
}

// How far `deadline` is from its place in the device's bus frames, within half a frame either way.
// The completion times of OUTs show where the frames begin.
rt::Duration ServoLoop::shift_to_bus_phase(rt::TimePoint deadline) noexcept {
  const rt::TimePoint released = device_->newest_report().released;
  if (released == rt::TimePoint{} || bus_frame_ <= rt::Duration::zero()) {
    return rt::Duration::zero();
  }
  const rt::Duration wanted = std::chrono::duration_cast<rt::Duration>(kBusPhase * bus_frame_);
  rt::Duration shift = (released - wanted - deadline) % bus_frame_;
  if (shift > bus_frame_ / 2) {
    shift -= bus_frame_;
  } else if (shift < -bus_frame_ / 2) {
    shift += bus_frame_;
  }
  return shift;
}

ServoOutcome ServoLoop::run(const std::atomic<bool>& stop, double seconds) noexcept {
  ServoOutcome outcome;
  rt::name_current_thread("servo");
  if (options_.realtime) {
    outcome.scheduling = rt::make_current_thread_realtime(rt::kServoPriority);
  }
  if (options_.lock_memory) {
    outcome.memory_lock_refused = rt::lock_memory();
  }
  const rt::ProcessorsAwake awake;
  outcome.awake_refused = awake.refused();

  const rt::Duration period = rt::from_seconds(1.0 / options_.rate_Hz);
  rt::TimePoint deadline = rt::Clock::now() + period + bus_frame_;
  deadline += shift_to_bus_phase(deadline);
  const rt::TimePoint end = deadline + rt::from_seconds(seconds);
  while (!stop.load(std::memory_order_relaxed) && (seconds <= 0.0 || deadline < end)) {
    rt::sleep_until(deadline);
    const rt::TimePoint now = rt::Clock::now();
    wakeup_us_ = 1e6 * rt::seconds(now - deadline);
    outcome.fault = run_cycle(now, deadline + period);
    if (outcome.fault != Fault::kNone) {
      break;
    }
    // Deadlines that have passed cannot be kept: count them and take the next on the schedule.
    deadline += period + std::clamp(shift_to_bus_phase(deadline), -kLargestShift, kLargestShift);
    missed_before_this_ = 0;
    for (const rt::TimePoint done = rt::Clock::now(); deadline < done; deadline += period) {
      ++missed_before_this_;
    }
    outcome.missed_deadlines += missed_before_this_;
  }
  if (emergency_stop_->pressed()) {  // perhaps together with `stop`, or after the last cycle
    outcome.fault = Fault::kEmergencyStop;
    outcome.emergency = emergency_stop_->source();
  }
  // The cycle with the fault has commanded zero already. The device's message is fetched before
  // stop(), after which the device reports only that it is closed.
  outcome.device_failure = outcome.fault == Fault::kNone ? std::string() : device_->failure();
  outcome.joint = outcome.fault == Fault::kNone ? -1 : faulty_joint_;
  outcome.zero_current_delivered = device_->stop();
  if (outcome.fault == Fault::kNone && !outcome.zero_current_delivered) {
    outcome.fault = Fault::kZeroNotDelivered;
  }
  add_counts(outcome);
  return outcome;
}

void ServoLoop::add_counts(ServoOutcome& outcome) const noexcept {
  outcome.cycles = cycle_;
  outcome.stalls = stalls_;
  outcome.requests_made = intake_.queries_sent();
  outcome.answers_taken = intake_.answers_taken();
  outcome.samples_refused = intake_.samples_refused();
  outcome.first_touches = first_touch_.counts();
  outcome.suspected_stuck_encoders = limiter_.suspected_stuck_encoders();
  const PassivityGuard& guard = renderer_.guard();
  outcome.energy_to_hand_J = guard.total_energy_to_hand_J();
  outcome.largest_energy_to_hand_J = guard.largest_energy_to_hand_J();
  outcome.damped_energy_J = guard.damped_energy_J();
  outcome.cycles_damped = renderer_.cycles_damped();
  outcome.cycles_shortened = renderer_.cycles_shortened();
  outcome.cycles_touching_tools = tool_touch_.cycles_touching();
  outcome.largest_tool_force_N = tool_touch_.largest_force_N();
}

}  // namespace forcegrid::servo
