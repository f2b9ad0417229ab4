#include "servo_loop/servo_loop.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "rt/processors_awake.h"

namespace forcegrid::servo {
namespace {

// The device's I/O thread sends zero current after 50 ms of silence, so a longer pause is a new
// start for the force.
constexpr rt::Duration kStall = std::chrono::milliseconds(50);

double to_us(rt::Duration duration) noexcept { return 1e6 * rt::seconds(duration); }

}  // namespace

ServoLoop::ServoLoop(driver::Device& device, const profiles::DeviceProfile& profile,
                     std::vector<ForceMethod*> methods, ServoPorts& ports,
                     const ServoOptions& options)
    : device_(&device),
      profile_(profile),
      mechanism_(driver::make_mechanism(profile)),
      limiter_(profile),
      guard_(profile, options.report_timeout),
      encoder_watch_(profile),
      first_touch_(profile.limits.max_force_N),
      motor_check_(profile, rt::from_seconds(1.0 / std::max(1.0, options.rate_Hz))),
      renderer_(profile, options.rendering),
      warmth_(profile),
      emergency_stop_(options.emergency_stop != nullptr ? options.emergency_stop
                                                        : &own_emergency_stop_),
      button_(profile),
      methods_(std::move(methods)),
      ports_(ports),
      options_(options),
      bus_frame_(std::chrono::microseconds(profile.usb.frame_period_us)),
      gate_(profile.limits.max_force_N),
      sample_period_s_(1.0 / options.simulator_rate_Hz) {
  if (!(options_.rate_Hz >= 100.0 && options_.rate_Hz <= 4000.0)) {
    throw std::invalid_argument("servo rate: use 100 to 4000 Hz");
  }
  if (!(options_.simulator_rate_Hz > 0.0 && options_.simulator_rate_Hz <= 4000.0)) {
    throw std::invalid_argument("simulator rate: use more than 0 and at most 4000 Hz");
  }
  if (!(options_.requests_per_s >= 0.0 && options_.requests_per_s <= options_.rate_Hz)) {
    throw std::invalid_argument("requests: use 0 to one a cycle");
  }
  if (options_.dead_man == DeadMan::kButton && !DeviceButton::can_be_held(profile)) {
    throw std::invalid_argument("dead man: profile " + profile.name +
                                " describes a device without a button that can be held");
  }
  if (options_.dead_man == DeadMan::kSignal && options_.dead_man_signal == nullptr) {
    throw std::invalid_argument("dead man: the signal is missing");
  }
  if (options_.fill_budget < 1) {
    throw std::invalid_argument("fill budget: use at least 1 a cycle");
  }
  asks_before_contact_ =
      !methods_.empty() && methods_[0] != nullptr && methods_[0]->needs().requests_before_contact;
  if (methods_.empty() || methods_.size() > kMaxMethods ||
      std::count(methods_.begin(), methods_.end(), nullptr) > 0) {
    throw std::invalid_argument("servo loop: 1 to 4 methods");
  }
}

Fault ServoLoop::run_cycle(rt::TimePoint now, rt::TimePoint next_read) noexcept {
  CycleRecord record;
  const double elapsed_s = begin_cycle(now, record);

  // Encoder report -> counts -> joint angles -> tool, believed only if plausible.
  const SensedTool tool = sense(now);
  Fault fault = tool.fault;
  if (fault == Fault::kNone) {
    send_tool_state(now, tool.touching_W);
  }

  // What the simulator has said since the last cycle, and the force there from each method.
  take_samples(now);
  ask_methods(now, tool.touching_W, record);

  // A touch that the simulator has not answered yet is felt by the loop's own copy of the surface.
  const Eigen::Vector3d felt_force_W =
      first_touch_.force_W(servo_time_s(now), tool.touching_W, vector(record.method_force_W_N[0]));

  // Which way the motors push is known before anything is felt.
  const HeldBack held_back = why_held_back(now);
  if (held_back == HeldBack::kDeadMan) {
    motor_check_.restart();
  } else if (fault == Fault::kNone && held_back == HeldBack::kMotorCheck && has_sample_) {
    fault = check_motors(now, tool.report, tool.pose);
  }

  // Ramp, fade, workspace bound, passivity; then every limit of the profile, and torque to current.
  const Eigen::Vector3d wanted_force_D =
      renderer_.force(cycle_to_render(now, elapsed_s, tool.position_W, felt_force_W), tool.pose);
  driver::LimitedForce limited =
      limiter_.apply(wanted_force_D, tool.pose, elapsed_s,
                     gravity_torque_Nm(elapsed_s, tool.pose) + motor_check_.joint_torque_Nm());
  cool(elapsed_s, limited);
  if (fault == Fault::kNone && (limited.acted & driver::kLimitNotFinite) != 0) {
    fault = Fault::kNotFinite;
  }

  // Out it goes; a fault commands zero.
  driver::MotorCommand command;
  command.next_read = next_read;
  if (fault == Fault::kNone) {
    command.current_A = limited.current_A;
    command.joint_torque_Nm = triple(limited.joint_torque_Nm);
    record.commanded_force_D_N = triple(limited.force_D);
    if (options_.watch_encoders) {
      relieve(now, elapsed_s, tool.pose.jacobian_D.transpose() * limited.force_D, command);
    }
  }
  device_->command(command);
  last_current_A_ = command.current_A;
  // A joint that the encoder watch relieves stands still, so that its force gives nothing.
  renderer_.set_rendered(limited.torque_scale * vector(record.commanded_force_D_N));

  if (fault == Fault::kNone && options_.requests_per_s > 0.0 && now >= next_request_) {
    make_request(now, tool.touching_W);
  }

  // What the budget leaves goes into filling.
  for (ForceMethod* method : methods_) {
    method->work(options_.fill_budget);
  }

  record.current_A = command.current_A;
  record.limits_acted = limited.acted;
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

ServoLoop::SensedTool ServoLoop::sense(rt::TimePoint now) noexcept {
  SensedTool tool;
  tool.report = device_->newest_report();
  tool.pose = mechanism_->forward(tool.report.counts);
  tool.fault = guard_.check(now, device_->health(), tool.report, tool.pose);
  faulty_joint_ = guard_.joint();
  if (tool.fault == Fault::kNone && options_.watch_encoders) {
    if (const auto joint = encoder_watch_.check(now, tool.report)) {
      tool.fault = Fault::kFrozenEncoder;
      faulty_joint_ = *joint;
    }
  }
  if (emergency(tool.report)) {
    tool.fault = Fault::kEmergencyStop;
  }
  tool.position_W = options_.workspace.position_W(tool.pose.position_D);
  tool.touching_W = renderer_.touching_W(tool.position_W);
  return tool;
}

void ServoLoop::ask_methods(rt::TimePoint now, const Eigen::Vector3d& touching_W,
                            CycleRecord& record) noexcept {
  const double time_s = servo_time_s(now);
  for (std::size_t i = 0; i < methods_.size(); ++i) {
    methods_[i]->observe(time_s, touching_W);
    if (contact_expected_) {
      methods_[i]->expect_contact(time_s, expected_point_W_);
    }
    const ForceEstimate estimate = methods_[i]->force(time_s, touching_W);
    record.method_force_W_N[i] = triple(estimate.force_W);
    record.method_status[i] = estimate.status;
    record.method_uncertainty_N[i] = estimate.uncertainty_N;
    if (i == 0) {
      record.rendered_member = estimate.candidate;
      record.rendered_reason = estimate.reason;
    }
  }
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
  record.position_W_m = triple(tool.position_W);
  record.touching_W_m = triple(tool.touching_W);
  record.velocity_W_m_per_s = triple(guard_.velocity_D());
  renderer_.describe(record);
  record.motor_warmth = warmth_.warmest();
  record.in_contact = in_contact_;
  record.contact_epoch = contact_epoch_;
  record.samples_taken = samples_taken_;
  record.sample_age_ms = has_sample_ ? 1e3 * (servo_time_s(now) - newest_sample_time_s_) : -1.0;
  record.compute_us = to_us(rt::Clock::now() - now);
  if (!ports_.records.push(record)) {
    ports_.records_lost.fetch_add(1, std::memory_order_relaxed);
  }
}

// What has flowed since the last cycle warms the motors; warm ones get less.
void ServoLoop::cool(double elapsed_s, driver::LimitedForce& limited) noexcept {
  warmth_.advance(elapsed_s, last_current_A_);
  const double scale = warmth_.scale(limited.current_A);
  if (scale < 1.0) {
    for (double& current_A : limited.current_A) {
      current_A *= scale;
    }
    limited.joint_torque_Nm *= scale;
    limited.torque_scale *= scale;
    limited.acted = static_cast<std::uint8_t>(limited.acted | driver::kLimitWarm);
  }
}

bool ServoLoop::emergency(const driver::DeviceReport& report) noexcept {
  button_.update(report);
  if (button_.pressed() && options_.dead_man != DeadMan::kButton) {
    emergency_stop_->press(EmergencySource::kDeviceButton);
  }
  return emergency_stop_->pressed();
}

HeldBack ServoLoop::why_held_back(rt::TimePoint now) const noexcept {
  const bool held = options_.dead_man == DeadMan::kNone ||
                    (options_.dead_man == DeadMan::kButton ? button_.held()
                                                           : options_.dead_man_signal->held(now));
  if (!held) {
    return HeldBack::kDeadMan;
  }
  return options_.check_motors && !motors_checked_ ? HeldBack::kMotorCheck : HeldBack::kNot;
}

ForceRenderer::Cycle ServoLoop::cycle_to_render(rt::TimePoint now, double elapsed_s,
                                                const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& felt_force_W) noexcept {
  ForceRenderer::Cycle cycle;
  cycle.elapsed_s = elapsed_s;
  cycle.position_W = position_W;
  cycle.velocity_W = guard_.velocity_D();
  cycle.method_force_W = felt_force_W;
  cycle.sample_age_s = has_sample_ ? rt::seconds(now - newest_sample_arrived_)
                                   : std::numeric_limits<double>::infinity();
  cycle.sample_period_s = sample_period_s_;
  cycle.held_back = why_held_back(now);
  cycle.in_contact = in_contact_ || first_touch_.acting();
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

// Leads off the part of each joint's torque that comes from the force; what carries the links
// stays.
void ServoLoop::relieve(rt::TimePoint now, double elapsed_s, const Eigen::Vector3d& force_torque_Nm,
                        driver::MotorCommand& command) noexcept {
  const Eigen::Array3d part = encoder_watch_.relief(now, elapsed_s, force_torque_Nm);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    const double torque_Nm = command.joint_torque_Nm[i];
    if (part[axis] >= 1.0 || torque_Nm == 0.0) {
      continue;
    }
    // A limit may have scaled the torque down; no more is led off than there is.
    const double left_Nm = torque_Nm - (1.0 - part[axis]) * force_torque_Nm[axis];
    const double ratio = std::clamp(left_Nm / torque_Nm, 0.0, 1.0);
    command.joint_torque_Nm[i] *= ratio;
    command.current_A[i] *= ratio;
  }
}

void ServoLoop::continue_with(driver::Device& device) {
  device_ = &device;
  guard_ = MotionGuard(profile_, options_.report_timeout);
  limiter_.reset();
  button_.restart();
  encoder_watch_.restart();
  motor_check_ = MotorCheck(profile_, rt::from_seconds(1.0 / options_.rate_Hz));
  motors_checked_ = false;
  first_touch_.forget();
  has_sample_ = false;  // what was said before is about a hand that has moved on
  gate_.forget();
  renderer_.drop();
  gravity_gain_ = 0.0;
  faulty_joint_ = -1;
  missed_before_this_ = 0;
  first_cycle_ = true;
}

void ServoLoop::start_anew() noexcept {
  ++stalls_;
  encoder_watch_.restart();
  motor_check_.restart();
  first_touch_.forget();
  renderer_.drop();
  gravity_gain_ = 0.0;
  limiter_.reset();
}

// How far `deadline` is from where it should lie against the device's bus frames, whose beginnings
// the completion times of OUTs show; within half a frame either way.
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
  outcome.scheduling = rt::make_current_thread_realtime(rt::kServoPriority);
  outcome.memory_lock_refused = rt::lock_memory();
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
    // A deadline that has passed by now can't be kept: count it, take the next on the same raster.
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
  // The cycle that ended the loop by a fault has commanded zero already. Asked before stop(), after
  // which the device only says that it is closed.
  outcome.device_failure = outcome.fault == Fault::kNone ? std::string() : device_->failure();
  outcome.joint = outcome.fault == Fault::kNone ? -1 : faulty_joint_;
  outcome.zero_current_delivered = device_->stop();
  if (outcome.fault == Fault::kNone && !outcome.zero_current_delivered) {
    outcome.fault = Fault::kZeroNotDelivered;
  }
  outcome.cycles = cycle_;
  outcome.stalls = stalls_;
  outcome.requests_made = requests_made_;
  outcome.answers_taken = answers_taken_;
  outcome.samples_refused = gate_.refused();
  outcome.first_touches = first_touch_.counts();
  outcome.suspected_stuck_encoders = encoder_watch_.suspicions();
  const PassivityGuard& guard = renderer_.guard();
  outcome.energy_to_hand_J = guard.total_energy_to_hand_J();
  outcome.largest_energy_to_hand_J = guard.largest_energy_to_hand_J();
  outcome.damped_energy_J = guard.damped_energy_J();
  outcome.cycles_damped = renderer_.cycles_damped();
  outcome.cycles_shortened = renderer_.cycles_shortened();
  return outcome;
}

}  // namespace forcegrid::servo
