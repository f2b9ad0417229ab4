// SPDX-License-Identifier: Apache-2.0
#include "device_session/device_session.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <thread>

#include "device_session/commanded_force.h"
#include "device_session/emulator_process.h"
#include "device_session/motor_timing.h"
#include "driver/calibration.h"
#include "driver/counter_continuity.h"
#include "driver/device_url.h"
#include "driver/mechanism.h"
#include "driver/open_device.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/latest_value.h"
#include "rt/thread.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"
#include "tools/unit_profile.h"

namespace forcegrid::session {
namespace {

using Reason = SessionError::Reason;

constexpr char kEmulated[] = "emulated:";
constexpr char kUsualProfile[] = "woodenhaptics_v2015";
constexpr rt::Duration kRetry = std::chrono::milliseconds(50);
constexpr rt::Duration kLastClientGoes = std::chrono::milliseconds(300);
constexpr rt::Duration kCalibrationRound = std::chrono::hours(24);
constexpr rt::Duration kCalibrateNow = std::chrono::seconds(3);
constexpr rt::Duration kLook = std::chrono::milliseconds(5);
constexpr rt::Duration kCycleTakes = std::chrono::microseconds(60);  // from its start to its state
constexpr rt::Duration kSoonest = std::chrono::microseconds(40);
constexpr rt::Duration kLatest = std::chrono::milliseconds(2);
constexpr double kMostCycles = 1e6;
constexpr double kSimulatorRate_Hz = 60.0;  // until samples have shown it
constexpr double kSampleTimeout_s = 0.2;
constexpr double kNoForce_N = 1e-9;
constexpr int kCells = 24;

bool is_emulated(const SessionOptions& options) { return options.device.starts_with(kEmulated); }

std::string profile_name_of(const SessionOptions& options) {
  if (!options.profile.empty()) {
    return options.profile;
  }
  if (is_emulated(options)) {
    return options.device.substr(sizeof kEmulated - 1);
  }
  const bool falcon =
      driver::parse_device_url(options.device).kind == driver::DeviceUrl::Kind::kFalcon;
  return falcon ? "falcon" : kUsualProfile;
}

MethodOptions method_options(const profiles::DeviceProfile& profile) {
  MethodOptions options;
  options.grid.min_W = rt::to_vector(profile.limits.workspace_min_m);
  options.grid.max_W = rt::to_vector(profile.limits.workspace_max_m);
  options.grid.cells = {kCells, kCells, kCells};
  return options;
}

std::unique_ptr<ForceMethod> method_of(const SessionOptions& options,
                                       const profiles::DeviceProfile& profile) {
  if (options.method.empty()) {
    return nullptr;
  }
  const MethodVariant variant = parse_method_variant(options.method, method_options(profile));
  return make_force_method(variant.name, variant.options);
}

std::unique_ptr<MotorTiming> timing_of(const SessionOptions& options, servo::ServoPorts& ports) {
  const char* const asked = std::getenv("FORCEGRID_TIMING");
  const std::string file = !options.timing_file.empty() ? options.timing_file
                           : asked != nullptr           ? asked
                                                        : "";
  return file.empty() ? nullptr : std::make_unique<MotorTiming>(ports, options.rate_Hz, file);
}

// A device and what is known of it before its loop begins.
struct Opened {
  std::unique_ptr<EmulatorProcess> emulator;
  profiles::DeviceProfile profile;
  std::string url;  // that finds the same unit again
  std::unique_ptr<driver::Device> device;
};

driver::OpenOptions open_options(const SessionOptions& options) {
  driver::OpenOptions result;
  result.connect_timeout = options.open_timeout;
  result.open_timeout = options.open_timeout;
  result.realtime_io = options.realtime;
  result.notice = options.notice;
  if (is_emulated(options)) {
    result.firmware = driver::falcon::synthetic_firmware();
  } else if (!options.falcon_firmware.empty()) {
    result.firmware = driver::falcon::load_firmware(options.falcon_firmware);
  }
  return result;
}

// A server of devices takes a moment to see that the last client has gone.
std::unique_ptr<driver::Device> open_device(const std::string& url,
                                            const profiles::DeviceProfile& profile,
                                            const SessionOptions& options) {
  const rt::TimePoint give_up = rt::Clock::now() + kLastClientGoes;
  while (true) {
    try {
      return driver::open_device(url, profile, open_options(options));
    } catch (const driver::DeviceInUse&) {
      if (!url.starts_with("usbip:") || rt::Clock::now() > give_up) {
        throw;
      }
    }
    rt::sleep_until(rt::Clock::now() + kRetry);
  }
}

Opened open_everything(const SessionOptions& options) {
  Opened opened;
  const std::string name = profile_name_of(options);
  opened.profile = profiles::load_device_profile(name);
  opened.url = options.device;
  if (is_emulated(options)) {
    opened.emulator = std::make_unique<EmulatorProcess>(options, name);
    opened.url = opened.emulator->url();
  }
  opened.url = driver::lasting_url(opened.url, opened.profile);
  opened.device = open_device(opened.url, opened.profile, options);
  if (!is_emulated(options)) {
    const std::string key = tools::unit_key(opened.device->identity(), opened.url);
    if (const auto file = tools::find_unit_profile(opened.profile.name, key)) {
      opened.profile = profiles::load_device_profile(*file);
    }
  }
  return opened;
}

class Session final : public DeviceSession, private servo::CycleListener {
 public:
  Session(const SessionOptions& options, Opened opened);
  ~Session() override;
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  const profiles::DeviceProfile& profile() const noexcept override { return profile_; }
  std::string url() const override { return url_; }
  std::string serial() const override { return identity_.serial; }
  std::string manufacturer() const override { return identity_.manufacturer; }
  std::string product() const override { return identity_.product; }

  ToolState newest_state() const noexcept override { return state_.read(); }
  bool wait_for_cycle(std::uint64_t cycle, rt::TimePoint deadline) noexcept override;
  void enable_force(bool on) noexcept override { switch_.turn(on); }
  bool force_enabled() const noexcept override { return switch_.turned_on(); }
  bool command_wrench(const std::array<double, 3>& force_D_N,
                      const std::array<double, 3>& torque_D_Nm,
                      rt::Duration hold) noexcept override;
  bool push_sample(std::int64_t time_ns, const std::array<double, 3>& position_D_m,
                   const std::array<double, 3>& force_D_N) noexcept override;
  void busy() noexcept override { commanded_.busy(rt::Clock::now()); }
  void idle() noexcept override { commanded_.idle(); }
  SessionHealth health() const noexcept override { return health_.load(); }
  std::string failure() const override;
  std::string calibrate_now() override;
  bool close() noexcept override;

  /// Until the first cycle has ended. @throws SessionError.
  void wait_until_running(rt::Duration timeout);

 private:
  void cycle_ended(const servo::CycleRecord& record, const driver::DeviceReport& report,
                   const driver::ArmPose& pose) noexcept override;
  servo::ServoOptions servo_options() noexcept;
  void run_motors() noexcept;
  void run_loop();
  bool calibrated_device();
  bool look_for_device();
  void publish_rest(servo::Fault fault) noexcept;
  void set_health(SessionHealth health, const std::string& why) noexcept;
  void write_timing() noexcept;

  const SessionOptions options_;
  const profiles::DeviceProfile profile_;
  const std::string url_;
  std::unique_ptr<EmulatorProcess> emulator_;
  std::unique_ptr<driver::Device> device_;
  const driver::DeviceIdentity identity_;

  servo::ForceSwitch switch_;
  CommandedForce commanded_;
  std::unique_ptr<ForceMethod> method_;
  servo::ServoPorts ports_;
  std::unique_ptr<MotorTiming> timing_;  ///< null: nobody asked for it
  servo::ServoLoop loop_;

  // The contact that push_sample() has told of.
  bool in_contact_ = false;
  std::uint32_t contact_epoch_ = 0;
  Eigen::Vector3d contact_point_W_ = Eigen::Vector3d::Zero();

  rt::LatestValue<ToolState> state_;
  ToolState last_;  // of the motor thread
  std::atomic<SessionHealth> health_{SessionHealth::kRunning};
  mutable std::mutex failure_mutex_;
  std::string failure_;
  std::atomic<bool> closing_{false};
  std::atomic<bool> calibrate_now_{false};
  std::mutex close_mutex_;
  bool closed_ = false;
  bool zero_delivered_ = false;
  bool realtime_ = false;  ///< the motor thread had SCHED_FIFO in its last run
  std::thread motors_;
};

Session::Session(const SessionOptions& options, Opened opened)
    : options_(options),
      profile_(opened.profile),
      url_(opened.url),
      emulator_(std::move(opened.emulator)),
      device_(std::move(opened.device)),
      identity_(device_->identity()),
      commanded_(options.longest_callback),
      method_(method_of(options, profile_)),
      timing_(timing_of(options, ports_)),
      loop_(*device_, profile_, {method_ ? method_.get() : static_cast<ForceMethod*>(&commanded_)},
            ports_, servo_options()) {
  motors_ = std::thread([this] { run_motors(); });
}

Session::~Session() { close(); }

servo::ServoOptions Session::servo_options() noexcept {
  servo::ServoOptions result;
  result.rate_Hz = options_.rate_Hz;
  result.simulator_rate_Hz = kSimulatorRate_Hz;
  result.gravity_compensation = options_.gravity_compensation;
  result.check_motors = options_.check_motors;
  result.rendering.ladder.ramp_in_s = options_.ramp_in_s;
  result.rendering.ladder.sample_timeout_s = kSampleTimeout_s;
  // What a program commands is its own; what a method makes of a slow program's forces is ours.
  result.rendering.passivity.mode =
      options_.method.empty() ? servo::PassivityMode::kObserve : servo::PassivityMode::kControl;
  result.dead_man = servo::DeadMan::kSwitch;
  result.force_switch = &switch_;
  result.needs_samples = !options_.method.empty();
  result.torque = options_.method.empty() ? &commanded_ : nullptr;
  result.listener = this;
  result.lock_memory = false;  // the program's memory is the program's
  result.realtime = options_.realtime;
  return result;
}

// Cycles come at known times, so that the motor thread need not wake anybody: that would cost it a
// system call a cycle. A cycle that is late is looked for ever less often.
bool Session::wait_for_cycle(std::uint64_t cycle, rt::TimePoint deadline) noexcept {
  const rt::Duration period = rt::from_seconds(1.0 / options_.rate_Hz);
  while (true) {
    const ToolState state = state_.read();
    if (state.cycle > cycle) {
      return true;
    }
    const rt::TimePoint now = rt::Clock::now();
    if (now >= deadline) {
      return false;
    }
    const double cycles = static_cast<double>(cycle - state.cycle) + 1.0;
    const rt::TimePoint expected =
        rt::TimePoint(rt::Duration(state.time_ns)) +
        rt::from_seconds(std::min(cycles, kMostCycles) * rt::seconds(period)) + kCycleTakes;
    const rt::Duration late = now - expected;
    rt::sleep_until(std::min(deadline, late < rt::Duration::zero()
                                           ? expected
                                           : now + std::clamp(late / 2, kSoonest, kLatest)));
  }
}

bool Session::command_wrench(const std::array<double, 3>& force_D_N,
                             const std::array<double, 3>& torque_D_Nm, rt::Duration hold) noexcept {
  Eigen::Vector3d force_D = rt::to_vector(force_D_N);
  const Eigen::Vector3d torque_D = rt::to_vector(torque_D_Nm);
  if (method_ || !force_D.allFinite() || !torque_D.allFinite()) {
    return false;
  }
  const double most_N = profile_.limits.max_force_N;
  if (const double wanted_N = force_D.norm(); wanted_N > most_N) {
    // The norm of numbers beyond 1e154 is infinite.
    force_D = std::isfinite(wanted_N) ? Eigen::Vector3d(force_D * (most_N / wanted_N))
                                      : Eigen::Vector3d(force_D.stableNormalized() * most_N);
  }
  commanded_.command(force_D, torque_D, rt::Clock::now(), hold);
  return true;
}

bool Session::push_sample(std::int64_t time_ns, const std::array<double, 3>& position_D_m,
                          const std::array<double, 3>& force_D_N) noexcept {
  servo::ArrivedSample arrived;
  arrived.sample.time_s = 1e-9 * static_cast<double>(time_ns);
  arrived.sample.position_W = rt::to_vector(position_D_m);
  arrived.sample.force_W = rt::to_vector(force_D_N);
  if (!method_ || !arrived.sample.position_W.allFinite() || !arrived.sample.force_W.allFinite()) {
    return false;
  }
  arrived.in_contact = arrived.sample.force_W.norm() > kNoForce_N;
  if (arrived.in_contact != in_contact_) {
    in_contact_ = arrived.in_contact;
    ++contact_epoch_;
    contact_point_W_ = arrived.sample.position_W;
  }
  arrived.sample.contact_epoch = contact_epoch_;
  arrived.sample.contact_point_W = in_contact_ ? contact_point_W_ : arrived.sample.position_W;
  arrived.arrived = rt::Clock::now();
  return ports_.samples.push(arrived);
}

std::string Session::failure() const {
  const std::lock_guard lock(failure_mutex_);
  return failure_;
}

void Session::set_health(SessionHealth health, const std::string& why) noexcept {
  try {
    const std::lock_guard lock(failure_mutex_);
    failure_ = why;
  } catch (...) {  // without memory the health alone has to tell
  }
  health_.store(health);
}

void Session::cycle_ended(const servo::CycleRecord& record, const driver::DeviceReport& report,
                          const driver::ArmPose& pose) noexcept {
  ToolState& state = last_;
  ++state.cycle;
  state.time_ns = record.time_ns;
  state.position_D_m = record.position_W_m;  // W is D here
  state.velocity_D_m_per_s = record.velocity_W_m_per_s;
  state.has_orientation = record.has_orientation;
  state.orientation_DT_wxyz = record.orientation_WT_wxyz;
  state.angular_velocity_D_rad_per_s = record.angular_velocity_W_rad_per_s;
  state.gimbal_angle_rad = record.gimbal_angle_rad;
  state.joint_angle_rad = rt::to_array(pose.joint_angle_rad);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      state.jacobian_D_m_per_rad[static_cast<std::size_t>(3 * row + column)] =
          pose.jacobian_D(row, column);
    }
  }
  state.commanded_force_D_N = record.commanded_force_D_N;
  if (profile_.gimbal_motors.present) {
    state.commanded_torque_D_Nm = record.tool_torque_W_Nm;
  }
  state.current_A = record.current_A;
  state.counts = report.counts;
  state.motor_warmth = record.motor_warmth;
  state.force_gain = record.gain;
  state.buttons = report.buttons;
  state.limits_acted = record.limits_acted;
  state.missed_deadlines += record.missed_deadlines;
  state.held_back = static_cast<std::uint8_t>(record.held_back);
  state.fault = static_cast<std::uint8_t>(record.fault);
  state_.publish(state);
  // A method goes on from the samples that it has: the switch stops it.
  switch_.hold_back(method_ != nullptr &&
                    commanded_.callback_lasts_too_long(1e-9 * static_cast<double>(record.time_ns)));
}

// The last place, at rest and without force.
void Session::publish_rest(servo::Fault fault) noexcept {
  last_.velocity_D_m_per_s = {};
  last_.angular_velocity_D_rad_per_s = {};
  last_.commanded_force_D_N = {};
  last_.commanded_torque_D_Nm = {};
  last_.current_A = {};
  last_.force_gain = 0.0;
  last_.buttons = 0;
  last_.fault = static_cast<std::uint8_t>(fault);
  ++last_.cycle;
  state_.publish(last_);
}

void Session::run_motors() noexcept {
  try {
    run_loop();
  } catch (const std::exception& error) {
    switch_.turn(false);
    set_health(SessionHealth::kFaulted, error.what());
    publish_rest(servo::Fault::kDeviceClosed);
  }
  if (device_) {
    zero_delivered_ = device_->stop() || zero_delivered_;
  }
}

void Session::run_loop() {
  if (!calibrated_device()) {
    return;
  }
  while (!closing_) {
    const servo::ServoOutcome outcome = loop_.run(closing_, 0.0);
    zero_delivered_ = outcome.zero_current_delivered;
    realtime_ = outcome.scheduling.realtime;
    if (closing_ || outcome.fault == servo::Fault::kNone) {
      return;
    }
    switch_.turn(false);
    const std::string why = servo::sentence_for(outcome.fault, outcome.joint) +
                            (outcome.device_failure.empty() ? "" : " ") + outcome.device_failure;
    if (!servo::may_be_over_after_reconnecting(outcome.fault)) {
      set_health(SessionHealth::kFaulted, why);
      publish_rest(outcome.fault);
      return;
    }
    set_health(SessionHealth::kLost, why);
    publish_rest(outcome.fault);
    if (!look_for_device()) {
      return;
    }
    loop_.continue_with(*device_);
    switch_.turn(false);  // whoever enabled force meanwhile meant the device as it was
    set_health(SessionHealth::kRunning, "");
  }
}

// Makes the counters absolute if need be. @returns false when the session closes instead.
bool Session::calibrated_device() {
  if (options_.calibrated || is_emulated(options_)) {
    return true;
  }
  set_health(SessionHealth::kUncalibrated, profiles::is_delta(profile_)
                                               ? profile_.falcon.homing_instruction
                                               : profile_.calibration.instruction);
  const auto mechanism = driver::make_mechanism(profile_);
  last_.position_D_m = rt::to_array(mechanism->forward(device_->newest_report().counts).position_D);
  publish_rest(servo::Fault::kNone);
  const bool by_person = driver::calibrate(*device_, profile_, kCalibrationRound, options_.notice,
                                           [this] { return closing_ || calibrate_now_; });
  if (!by_person && closing_) {
    return false;
  }
  if (!by_person) {
    driver::calibrate_now(*device_, profile_);
  }
  set_health(SessionHealth::kRunning, "");
  return true;
}

// Until the same device is back, with counters that can be true. @returns false when the session
// closes, or the counters are lost, instead.
bool Session::look_for_device() {
  const std::array<std::int32_t, 6> last_counts = last_.counts;
  const auto mechanism = driver::make_mechanism(profile_);
  while (!closing_) {
    device_.reset();
    try {
      device_ = driver::open_device(url_, profile_, open_options(options_));
      const std::string lost =
          driver::why_counters_are_lost(*mechanism, last_counts, device_->newest_report().counts);
      if (lost.empty()) {
        return true;
      }
      if (!options_.calibrated && !is_emulated(options_)) {
        return calibrated_device();
      }
      set_health(SessionHealth::kFaulted, lost + "; calibrate the device and open it anew");
      return false;
    } catch (const driver::DeviceError&) {
      rt::sleep_until(rt::Clock::now() + kRetry);
    }
  }
  return false;
}

std::string Session::calibrate_now() {
  if (health() != SessionHealth::kUncalibrated) {
    return health() == SessionHealth::kRunning ? "" : failure();
  }
  calibrate_now_ = true;
  const rt::TimePoint give_up = rt::Clock::now() + kCalibrateNow;
  while (health() == SessionHealth::kUncalibrated && rt::Clock::now() < give_up) {
    rt::sleep_until(rt::Clock::now() + kLook);
  }
  return health() == SessionHealth::kRunning ? "" : failure();
}

bool Session::close() noexcept {
  const std::lock_guard lock(close_mutex_);
  if (closed_) {
    return zero_delivered_;
  }
  closed_ = true;
  switch_.turn(false);
  closing_ = true;
  if (motors_.joinable()) {
    motors_.join();
  }
  device_.reset();
  emulator_.reset();
  write_timing();
  set_health(SessionHealth::kClosed, "the session is closed");
  return zero_delivered_;
}

void Session::write_timing() noexcept {
  try {
    const std::string trouble = timing_ ? timing_->finish(realtime_) : "";
    if (!trouble.empty() && options_.notice) {
      options_.notice(trouble);
    }
  } catch (...) {  // no times without memory
  }
}

void Session::wait_until_running(rt::Duration timeout) {
  if (!wait_for_cycle(0, rt::Clock::now() + timeout)) {
    throw SessionError(Reason::kAbsent, "device '" + url_ + "': no cycle within its time-out; " +
                                            "is the machine overloaded?");
  }
  if (health() == SessionHealth::kFaulted || health() == SessionHealth::kLost) {
    throw SessionError(Reason::kAbsent, "device '" + url_ + "': " + failure());
  }
}

}  // namespace

std::unique_ptr<DeviceSession> DeviceSession::open(const SessionOptions& options) {
  try {
    auto session = std::make_unique<Session>(options, open_everything(options));
    session->wait_until_running(options.open_timeout);
    return session;
  } catch (const driver::DeviceInUse& error) {
    throw SessionError(Reason::kInUse, error.what());
  } catch (const driver::DeviceError& error) {
    throw SessionError(Reason::kAbsent, error.what());
  } catch (const SessionError&) {
    throw;
  } catch (const std::exception& error) {  // a profile, an option, a method's name
    throw SessionError(Reason::kUnusable, error.what());
  }
}

}  // namespace forcegrid::session
