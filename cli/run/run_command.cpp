// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <stdexcept>
#include <thread>

#include "cli/common/figures.h"
#include "cli/common/firmware_choice.h"
#include "cli/common/stop_request.h"
#include "cli/run/reconnect.h"
#include "cli/run/recording.h"
#include "cli/run/run_checks.h"
#include "cli/run/run_judgement.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_processes.h"
#include "cli/run/run_setup.h"
#include "cli/run/run_summary_json.h"
#include "cli/run/run_summary_text.h"
#include "cli/run/terminal_keys.h"
#include "driver/calibration.h"
#include "driver/device_url.h"
#include "driver/discovery.h"
#include "driver/open_device.h"
#include "profiles/device_profile.h"
#include "rt/thread.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/telemetry.h"
#include "servo_loop/watched_run.h"
#include "tools/dashboard.h"
#include "tools/hdf5_file.h"
#include "tools/recorder.h"
#include "tools/unit_profile.h"

namespace forcegrid::cli {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kWatchdogProof{700};

// With a coupling, the guard only observes.
void set_passivity(const RunOptions& options, servo::ServoOptions& servo_options) {
  constexpr double kBoundOverAllowance = 2.0;
  servo_options.rendering.passivity.mode = options.passivity == "control"
                                               ? servo::PassivityMode::kControl
                                               : servo::PassivityMode::kObserve;
  servo_options.rendering.passivity.allowance_J = 1e-3 * options.passivity_allowance_mJ;
  servo_options.rendering.passivity.bound_J =
      kBoundOverAllowance * servo_options.rendering.passivity.allowance_J;
  servo_options.rendering.passivity.max_damping_N_s_per_m = options.passivity_damping_N_s_per_m;
  if (options.passivity == "coupling") {
    servo_options.rendering.coupling =
        servo::CouplingOptions{options.coupling.at(0), options.coupling.at(1)};
  }
}

void set_switches(const RunOptions& options, const profiles::DeviceProfile& profile,
                  servo::ServoOptions& servo_options) {
  StopRequest::install_switches();
  servo_options.emergency_stop = &StopRequest::emergency();
  servo_options.dead_man_signal = &StopRequest::dead_man();
  if (options.dead_man == "button") {
    if (!servo::DeviceButton::can_be_held(profile)) {
      throw std::runtime_error("--dead-man button: the only button of " + profile.name +
                               " latches when pressed and does not report whether it is held; use "
                               "--dead-man signal with a separate switch");
    }
    servo_options.dead_man = servo::DeadMan::kButton;
  } else if (options.dead_man == "signal") {
    servo_options.dead_man = servo::DeadMan::kSignal;
  }
}

servo::ServoOptions servo_options_of(const RunOptions& options,
                                     const profiles::DeviceProfile& profile) {
  servo::ServoOptions servo_options;
  servo_options.rate_Hz = options.rate_Hz;
  servo_options.fill_budget = options.fill_budget;
  servo_options.simulator_rate_Hz = options.simulator_rate_Hz;
  servo_options.report_timeout = milliseconds(options.device_timeout_ms);
  servo_options.gravity_compensation = options.gravity_compensation;
  servo_options.check_motors = !options.no_motor_check;
  set_passivity(options, servo_options);
  set_switches(options, profile, servo_options);
  return servo_options;
}

// Why this program's threads get no real-time scheduling; empty: they get it.
std::string why_not_realtime() {
  std::string reason;
  std::thread([&] { reason = rt::make_current_thread_realtime(rt::kServoPriority).reason; }).join();
  return reason;
}

// The calibrated profile of the opened unit; empty: none applies.
std::string calibrated_profile(const RunOptions& options, const std::string& profile_name,
                               const driver::DeviceIdentity& identity,
                               const std::string& lasting_url) {
  if (options.calibration == "none") {
    return "";
  }
  return options.calibration != "auto"
             ? options.calibration
             : tools::find_unit_profile(profile_name, tools::unit_key(identity, lasting_url))
                   .value_or("");
}

std::unique_ptr<driver::Device> open(const std::string& url, const profiles::DeviceProfile& profile,
                                     const driver::falcon::Firmware& firmware,
                                     int device_timeout_ms, bool realtime) {
  driver::OpenOptions open_options;
  open_options.firmware = firmware;
  open_options.realtime_io = realtime;
  open_options.stale_after = milliseconds(device_timeout_ms);
  open_options.notice = [](const std::string& text) { std::fprintf(stderr, "%s\n", text.c_str()); };
  try {
    return driver::open_device(url, profile, open_options);
  } catch (const driver::DeviceError& error) {
    if (url.rfind("hid:", 0) != 0 && url.rfind("falcon", 0) != 0) {
      throw;
    }
    std::vector<profiles::DeviceProfile> known;
    for (const std::string& name : profiles::available_profiles()) {
      known.push_back(profiles::load_device_profile(name));
    }
    throw driver::DeviceError(std::string(error.what()) + "\n" +
                              driver::describe_attached_devices(known));
  }
}

// One run, from its options to its summary. Members that threads write to come before those
// threads, so that the threads end before the members are destroyed.
class Run {
 public:
  /// Checks everything that can be checked before a process starts or a device is opened.
  explicit Run(const RunOptions& options);

  /// @returns the program's exit status.
  int execute();

 private:
  void say(const std::string& text);
  void note(const std::string& text) { summary_.notes.push_back(text); }
  void fail(const std::string& text);
  void look_at_keys(milliseconds timeout);

  void connect();
  bool calibrate_arm();
  int end_uncalibrated();
  void prepare_telemetry();
  void start_dashboard();
  void run_until_over();
  servo::ServoOutcome run_loop(double for_s);
  bool connect_again(rt::TimePoint ended);
  void stop_threads();
  void collect();
  void write_flight_records();
  void finish_processes();
  [[nodiscard]] std::string why_no_reference() const;
  void write_files(const ContactCycles& cycles);

  RunOptions options_;
  std::FILE* out_;
  std::unique_ptr<tools::Dashboard> dashboard_;
  simulator::ToolOptions tool_;
  profiles::DeviceProfile profile_;
  driver::falcon::Firmware firmware_;
  servo::ServoOptions servo_options_;
  std::optional<RunMethods> methods_;
  RunSummary summary_;
  std::string realtime_refused_;
  std::optional<RunProcesses> processes_;
  servo::ServoPorts ports_;
  std::unique_ptr<tools::Recorder> recorder_;
  std::optional<servo::LinkThread> link_;
  std::unique_ptr<driver::Device> device_;
  std::string url_again_;  // where to find the device again
  std::optional<TerminalKeys> keys_;
  std::optional<servo::Telemetry> telemetry_;
  std::optional<servo::ServoLoop> loop_;
  int status_ = 0;
};

// With the JSON on standard output, everything for people goes to standard error.
Run::Run(const RunOptions& options)
    : options_(options),
      out_(options.json.on_stdout() || options.text_on_stderr ? stderr : stdout) {
  if (options_.live) {
    tools::Dashboard::check(out_);
  }
  tool_ = tool_of(options_);
  profile_ = profiles::load_device_profile(profile_name_of(options_.device, options_.profile));
  check_together(options_, tool_, profile_);
  firmware_ = firmware_for(options_.firmware, profile_, is_emulated(options_));

  summary_.device = options_.device;
  summary_.device_profile = profile_.name;
  summary_.scene = options_.simulator.empty() ? options_.scene : "";
  summary_.method = options_.method;
  summary_.passivity = options_.passivity;
  summary_.rate_requested_Hz = options_.rate_Hz;

  servo_options_ = servo_options_of(options_, profile_);
  methods_.emplace(options_, method_options(options_, profile_, servo_options_.workspace));
  servo_options_.requests_per_s = methods_->requests_per_s(options_, tool_);
  prepare_folder(options_.out);
  check_writable(options_.json);
  check_recording(options_);

  // Reported once, here; the threads that are refused later stay silent.
  realtime_refused_ = why_not_realtime();
  if (!realtime_refused_.empty()) {
    say("No real-time scheduling: " + realtime_refused_ + "\n");
  }
}

int Run::execute() {
  connect();
  if (!calibrate_arm()) {
    return end_uncalibrated();
  }
  prepare_telemetry();
  loop_.emplace(*device_, profile_, methods_->methods(), ports_, servo_options_);
  if (options_.live) {
    start_dashboard();
  }
  link_->start();
  telemetry_->start();
  run_until_over();
  stop_threads();
  const bool emergency =
      summary_.outcome.fault == servo::Fault::kEmergencyStop || StopRequest::emergency().pressed();
  status_ = summary_.outcome.fault == servo::Fault::kNone ? 0 : 1;
  if (recorder_ && !recorder_->finish().trouble.empty()) {
    note("--record: " + recorder_->finish().trouble);
    status_ = 1;
  }
  if (!telemetry_->trouble().empty()) {
    fail("the live line and the recording ended early: " + telemetry_->trouble());
  }
  if (!link_->trouble().empty()) {
    fail("the link to the simulator ended early, and the force faded to zero: " + link_->trouble());
  }
  collect();
  write_flight_records();
  say(loop_text(summary_, telemetry_->statistics()));
  finish_processes();

  ContactCycles cycles = cycles_since(link_->first_contact(), telemetry_->records());
  judge(options_, methods_->names(), why_no_reference(), link_->first_contact(), out_, cycles,
        summary_);
  write_files(cycles);
  say(errors_text(summary_));
  write_json(options_.json, to_json(summary_, telemetry_->statistics()).dump(2));
  return emergency ? kEmergencyStatus : status_;
}

void Run::say(const std::string& text) {
  if (dashboard_) {
    dashboard_->note(text);
    return;
  }
  std::fputs(text.c_str(), out_);
  std::fflush(out_);
}

// A requested file can't be written.
void Run::fail(const std::string& text) {
  note(text);
  std::fprintf(stderr, "forcegrid: %s\n", text.c_str());
  status_ = 1;
}

void Run::look_at_keys(milliseconds timeout) {
  if (keys_->emergency_pressed(timeout)) {
    StopRequest::request_emergency(servo::EmergencySource::kKey);
  }
}

void Run::connect() {
  processes_.emplace(options_, tool_, profile_);
  link_.emplace(processes_->simulator_address(), ports_, processes_->take_link_keys());
  // Locking memory may take longer than the device's time-out, so it comes before opening the
  // device. The loop tries again and reports a refusal.
  static_cast<void>(rt::lock_memory());
  const std::string& url = processes_->device_url();
  device_ = open(url, profile_, firmware_, options_.device_timeout_ms, realtime_refused_.empty());
  const std::string base_profile = profile_.name;
  const std::string calibrated_file =
      calibrated_profile(options_, base_profile, device_->identity(),
                         is_emulated(options_) ? "emulated" : driver::lasting_url(url, profile_));
  if (!calibrated_file.empty()) {
    profile_ = profiles::load_device_profile(calibrated_file);
  }
  url_again_ =
      options_.reconnect ? driver::lasting_url(url, profile_) : url;  // while it is connected
  const driver::DeviceIdentity& identity = device_->identity();
  say("Device: " + identity.product + " (" + identity.manufacturer + ", serial " + identity.serial +
      ") at " + url + (processes_->has_emulator() ? " (emulated)" : "") + ", profile " +
      base_profile + "\n");
  if (!calibrated_file.empty()) {
    say("Calibrated profile of this unit: " + calibrated_file + "\n");
  }
  // No force has been rendered yet; a key pressed now must prevent force later.
  keys_.emplace();
}

// False: it was stopped before. A Falcon reports whether its axes are homed and has no force
// until then.
bool Run::calibrate_arm() {
  if (options_.calibrated && is_falcon(profile_)) {
    say("Falcon: --calibrated has no effect, because the device reports whether its axes are "
        "homed\n");
  }
  if (options_.calibrated && !is_falcon(profile_)) {
    return true;
  }
  return driver::calibrate(
      *device_, profile_, seconds(60), [&](const std::string& text) { say(text + "\n"); },
      [&] {
        look_at_keys(milliseconds(0));
        return StopRequest::stop().load();
      });
}

int Run::end_uncalibrated() {
  note("stopped before the arm was calibrated; the motors had no current");
  say(summary_.notes.back() + "\n");
  summary_.outcome.zero_current_delivered = device_->stop();
  summary_.device_statistics = device_->statistics();
  summary_.emulator = processes_->finish_emulator();
  summary_.simulator = processes_->finish_simulator();
  summary_.reference = "the loop never ran";
  write_json(options_.json, to_json(summary_, servo::TelemetryStatistics{}).dump(2));
  return StopRequest::emergency().pressed() ? kEmergencyStatus : 1;
}

void Run::prepare_telemetry() {
  say("Simulator: " + processes_->simulator_address() +
      (processes_->has_simulator() ? ", scene " + options_.scene : "") + "; method " +
      options_.method + " at " + std::to_string(std::lround(options_.rate_Hz)) +
      " Hz; Ctrl-C ends it" + (keys_->active() ? ", space or e stops the motors at once\n" : "\n"));
  recorder_ = start_recorder(options_, profile_, methods_->names(), processes_->device_url(),
                             device_->identity());
  if (records_trace(options_)) {
    link_->keep_samples(kRecordedSamples);
  }
  if (recorder_) {
    link_->on_sample([this](const servo::ArrivedSample& sample) { recorder_->push(sample); });
  }
  servo::TelemetryOptions telemetry_options;
  telemetry_options.method_names = methods_->names();
  telemetry_options.rate_Hz = options_.rate_Hz;
  telemetry_options.live = options_.live ? nullptr : out_;
  if (options_.live) {
    telemetry_options.on_sentence = [this](const std::string& text) { say(text); };
  }
  if (recorder_ || options_.live) {
    telemetry_options.on_cycle = [this](const servo::CycleRecord& cycle) {
      if (recorder_) {
        recorder_->push(cycle);
      }
      if (dashboard_) {
        dashboard_->add(cycle);
      }
    };
  }
  telemetry_.emplace(ports_, telemetry_options);
}

void Run::start_dashboard() {
  std::vector<std::string> candidates;
  for (const char* candidate : methods_->rendered().candidates()) {
    candidates.emplace_back(candidate);
  }
  keys_.reset();  // its signal handlers must be installed after the dashboard's
  const std::string simulator =
      processes_->has_simulator() ? options_.scene : processes_->simulator_address();
  dashboard_ = std::make_unique<tools::Dashboard>(
      out_, tools::DashboardTitle{options_.device, simulator, options_.method, candidates,
                                  options_.rate_Hz});
  keys_.emplace();
}

// Runs the loop until it ends by itself.
servo::ServoOutcome Run::run_loop(double for_s) {
  return servo::run_watched(*loop_, StopRequest::stop(), for_s, StopRequest::request, [this] {
    look_at_keys(milliseconds(20));
    if (const auto how = processes_->simulator_end()) {
      note("the simulator process " + *how + " during the run; the force faded to zero");
      say(summary_.notes.back() + "\n");
    }
  });
}

// Runs the loop; with --reconnect again after each fault that a disconnected device may have
// caused.
void Run::run_until_over() {
  double left_s = options_.seconds;
  for (;;) {
    const rt::TimePoint begun = rt::Clock::now();
    const std::uint64_t missed_before = summary_.outcome.missed_deadlines;
    summary_.outcome = run_loop(left_s);
    summary_.outcome.missed_deadlines += missed_before;
    const rt::TimePoint ended = rt::Clock::now();
    left_s -= options_.seconds > 0.0 ? rt::seconds(ended - begun) : 0.0;
    if (!options_.reconnect || !servo::may_be_over_after_reconnecting(summary_.outcome.fault) ||
        StopRequest::stop() || (options_.seconds > 0.0 && left_s <= 0.0) || !connect_again(ended)) {
      return;
    }
  }
}

// Waits for the disconnected device. False: it did not come back; a note gives the reason.
bool Run::connect_again(rt::TimePoint ended) {
  const servo::Fault fault = summary_.outcome.fault;
  say(servo::sentence_for(fault) + " (" + summary_.outcome.device_failure +
      ")\nWaiting for the device, at most " +
      std::to_string(std::lround(options_.reconnect_timeout_s)) + " s; Ctrl-C ends it.\n");
  Reconnect how;
  how.open = [&] {
    return open(url_again_, profile_, firmware_, options_.device_timeout_ms,
                realtime_refused_.empty());
  };
  how.cancelled = [&] {
    look_at_keys(milliseconds(0));
    return StopRequest::stop().load();
  };
  how.say = [&](const std::string& text) { say(text); };
  how.profile = &profile_;
  how.before = device_->identity();
  how.last_counts = device_->newest_report().counts;
  how.may_calibrate = !options_.calibrated || is_falcon(profile_);
  how.timeout = rt::from_seconds(options_.reconnect_timeout_s);
  driver::add(summary_.device_statistics, device_->statistics());
  device_.reset();
  Reconnected again = reconnect(how);
  if (!again.device) {
    note("the device was not reconnected: " + again.why_not);
    return false;
  }
  device_ = std::move(again.device);
  loop_->continue_with(*device_);
  summary_.recovered.push_back(
      {fault, summary_.outcome.device_failure, ended.time_since_epoch().count()});
  summary_.recalibrations += again.recalibrated ? 1 : 0;
  say("The device is back" +
      std::string(again.recalibrated ? " and calibrated" : " with its counters unchanged") +
      "; the force ramps in.\n");
  return true;
}

void Run::stop_threads() {
  if (summary_.outcome.fault == servo::Fault::kEmergencyStop) {
    StopRequest::request_emergency(summary_.outcome.emergency);  // skips the remaining work
  }
  StopRequest::main_part_is_over();
  keys_.reset();
  link_->stop();
  telemetry_->stop();
  dashboard_.reset();
  rt::unlock_memory();
}

// Copies the counters of device, link, telemetry and method.
void Run::collect() {
  for (const std::string& refused :
       {summary_.outcome.memory_lock_refused, summary_.outcome.awake_refused}) {
    if (!refused.empty()) {
      note(refused);
    }
  }
  if (device_) {
    driver::add(summary_.device_statistics, device_->statistics());
  }
  summary_.link = link_->statistics();
  summary_.samples_received = link_->samples_accepted();
  summary_.simulator_clock = link_->simulator_clock();
  summary_.samples_not_converged = link_->samples_not_converged();
  summary_.worst_relative_residual = link_->worst_relative_residual();
  summary_.worst_solve_time_s = link_->worst_solve_time_s();
  summary_.samples_overrun = link_->samples_lost();
  summary_.records_lost = ports_.records_lost.load();
  const auto& records = telemetry_->records();
  if (records.size() > 1) {
    summary_.elapsed_s =
        1e-9 * static_cast<double>(records.back().time_ns - telemetry_->first_time_ns());
  }
  if (servo_options_.requests_per_s > 0.0 && summary_.outcome.requests_made == 0) {
    note("method " + options_.method + " made no request");
  }
  if (link_->samples_accepted() == 0) {
    note("no sample came from " + processes_->simulator_address() +
         "; is a simulator listening there" +
         (options_.key_files.empty() ? "?" : " that has this key?") +
         " It serves one servo at a time");
  }
  summary_.cycles_kept = records.size();
  if (summary_.cycles_kept < telemetry_->statistics().cycles) {
    note("only the last " + std::to_string(summary_.cycles_kept) +
         " cycles were kept; errors, CSV and picture are theirs");
  }
  for (const NamedCounter& counter : methods_->rendered().counters()) {
    summary_.counters[counter.name] = counter.value;
  }
  for (const char* candidate : methods_->rendered().candidates()) {
    summary_.candidates.emplace_back(candidate);
  }
}

// The last seconds before each fault.
void Run::write_flight_records() {
  const auto write = [&](const std::string& name, std::int64_t end_ns) {
    const std::string file = options_.out + "/" + name;
    try {
      telemetry_->write_flight_record(file, servo::Telemetry::kFlightRecord_s, end_ns);
      summary_.files.push_back(file);
    } catch (const std::runtime_error& error) {
      note(error.what());
    }
  };
  for (std::size_t i = 0; i < summary_.recovered.size(); ++i) {
    write("flight_record_" + std::to_string(i + 1) + ".csv", summary_.recovered[i].time_ns);
  }
  if (summary_.outcome.fault != servo::Fault::kNone) {
    write("flight_record.csv", std::numeric_limits<std::int64_t>::max());
  }
}

void Run::finish_processes() {
  const bool emulated = processes_->has_emulator();
  if (emulated && !summary_.outcome.zero_current_delivered) {
    // Leaves time for the device's watchdog, which needs half a second.
    std::this_thread::sleep_for(kWatchdogProof);
  }
  summary_.emulator = processes_->finish_emulator();
  summary_.simulator = processes_->finish_simulator();
  if (summary_.emulator) {
    say(motors_text(*summary_.emulator));
  } else if (emulated) {
    note("the emulator wrote no report; it " + processes_->emulator_end());
    say("Note: " + summary_.notes.back() + "\n");
  }
  if (summary_.simulator) {
    say(workers_text(*summary_.simulator));
  }
}

// Why no reference forces are computed; empty: they are.
std::string Run::why_no_reference() const {
  if (!processes_->has_simulator()) {
    return "only the scenes of 'forcegrid simulate' have reference forces";
  }
  if (tool_.slides()) {
    return "none: the force on a sliding tool depends on its path";
  }
  return options_.no_reference ? "skipped by --no-reference" : "";
}

void Run::write_files(const ContactCycles& cycles) {
  const std::vector<std::string>& names = methods_->names();
  try {
    if (records_trace(options_)) {
      if (cycles.reference_W.empty()) {
        throw std::runtime_error("no trace was recorded in " + options_.record +
                                 ", because there are no reference forces: " + summary_.reference);
      }
      evaluation::write_trace(options_.record, trace_of(link_->samples(), cycles.records,
                                                        cycles.reference_W, cycles.contact_ns));
      summary_.files.push_back(options_.record);
    }
  } catch (const std::runtime_error& error) {
    fail(error.what());
  }
  try {
    for (std::string& file :
         write_figures(options_.out, names, figure_rows(cycles, names.size()))) {
      summary_.files.push_back(std::move(file));
    }
  } catch (const std::runtime_error& error) {
    fail(error.what());
  }
  if (!recorder_) {
    return;
  }
  summary_.files.push_back(options_.record);
  if (recorder_->finish().closed) {
    try {
      complete_recording(*recorder_, options_.record, cycles.records, cycles.reference_W,
                         to_json(summary_, telemetry_->statistics()).dump());
    } catch (const tools::Hdf5Error& error) {
      fail(error.what());
    }
  }
}

}  // namespace

int run_command(const RunOptions& options) { return Run(options).execute(); }

}  // namespace forcegrid::cli
