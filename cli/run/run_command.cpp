// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <thread>

#include "cli/common/figures.h"
#include "cli/common/firmware_choice.h"
#include "cli/common/stop_request.h"
#include "cli/common/stop_watchdog.h"
#include "cli/run/reconnect.h"
#include "cli/run/recording.h"
#include "cli/run/run_checks.h"
#include "cli/run/run_collect.h"
#include "cli/run/run_device.h"
#include "cli/run/run_judgement.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_processes.h"
#include "cli/run/run_servo_options.h"
#include "cli/run/run_setup.h"
#include "cli/run/run_summary_json.h"
#include "cli/run/run_summary_text.h"
#include "cli/run/run_view.h"
#include "cli/run/scene_change.h"
#include "cli/run/simulator_watch.h"
#include "cli/run/terminal_keys.h"
#include "cli/run/view_feed.h"
#include "cli/run/view_title.h"
#include "driver/calibration.h"
#include "driver/device_url.h"
#include "driver/discovery.h"
#include "driver/open_device.h"
#include "evaluation/gnuplot.h"
#include "log/log.h"
#include "profiles/device_profile.h"
#include "rt/checkpoint.h"
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
constexpr milliseconds kViewDrain{5};  // the view says within 20 ms that the servo has stopped

// Why this program's threads get no real-time scheduling; empty: they get it.
std::string why_not_realtime() {
  std::string reason;
  std::thread([&] { reason = rt::make_current_thread_realtime(rt::kServoPriority).reason; }).join();
  return reason;
}

// CLOCK_MONOTONIC, as the samples' times of arrival.
double now_s() { return 1e-9 * static_cast<double>(rt::Clock::now().time_since_epoch().count()); }

// One run, from its options to its summary. Members that threads write to come before those
// threads, so that the threads end before the members are destroyed.
class Run {
 public:
  /// Checks everything that can be checked before a process starts or a device is opened.
  /// @param view  that goes on from run to run; null: the first one with a view starts it.
  Run(const RunOptions& options, std::unique_ptr<ViewProcess>& view);

  /// @returns the program's exit status.
  int execute();
  /// The scene that another run is to begin with; nothing: there is to be none.
  std::optional<std::string> next_scene();

 private:
  void say(const std::string& text, log::Level level = log::Level::kInfo,
           const char* component = "run") const;
  void report(const std::string& text) const;
  void report_fault() const;
  void note(const std::string& text) { summary_.notes.push_back(text); }
  void fail(const std::string& text);
  void look_at_keys(milliseconds timeout);

  void connect();
  bool calibrate_arm();
  int end_uncalibrated();
  void prepare_telemetry();
  void start_dashboard();
  void start_view();
  void end_view();
  void run_until_over();
  servo::ServoOutcome run_loop(double for_s);
  bool connect_again(rt::TimePoint ended);
  void watch_simulator();
  void judge_end();
  void settle_status();
  void stop_threads();
  void finish_processes();
  [[nodiscard]] std::string why_no_reference() const;
  void write_files(const ContactCycles& cycles);

  RunOptions options_;
  std::unique_ptr<ViewProcess>& kept_view_;
  NextScene next_scene_;
  std::FILE* out_;
  std::unique_ptr<tools::Dashboard> dashboard_;
  std::optional<log::ConsoleTaker> to_dashboard_;  // while it covers the terminal
  simulator::ToolOptions tool_;
  profiles::DeviceProfile profile_;
  driver::falcon::Firmware firmware_;
  servo::ServoOptions servo_options_;
  MethodOptions method_options_;
  std::optional<RunMethods> methods_;
  RunSummary summary_;
  std::string realtime_refused_;
  std::unique_ptr<tools::Recorder> recorder_;
  std::optional<RunProcesses> processes_;
  servo::ServoPorts ports_;
  std::unique_ptr<ViewFeed> view_;
  std::optional<servo::LinkThread> link_;
  std::optional<SimulatorWatch> watch_;
  bool simulator_died_ = false;
  std::optional<OwnEnd> own_end_;  // from when motors may get current until everything is written
  std::unique_ptr<driver::Device> device_;
  std::string url_again_;  // where to find the device again
  std::optional<TerminalKeys> keys_;
  std::optional<servo::Telemetry> telemetry_;
  std::optional<servo::ServoLoop> loop_;
  bool file_failed_ = false;
};

// With the JSON on standard output, everything for people goes to standard error.
Run::Run(const RunOptions& options, std::unique_ptr<ViewProcess>& view)
    : options_(options),
      kept_view_(view),
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
  method_options_ = method_options(options_, profile_, servo_options_.workspace);
  methods_.emplace(options_, method_options_);
  servo_options_.requests_per_s = methods_->requests_per_s(options_, tool_);
  prepare_folder(options_.out);
  check_writable(options_.json);
  check_recording(options_);

  // Reported once, here; the threads that are refused later stay silent.
  realtime_refused_ = why_not_realtime();
  if (!realtime_refused_.empty()) {
    say("No real-time scheduling: " + realtime_refused_);
  }
}

int Run::execute() {
  connect();
  if (!calibrate_arm()) {
    return end_uncalibrated();
  }
  start_view();
  prepare_telemetry();
  loop_.emplace(*device_, profile_, methods_->methods(), ports_, servo_options_);
  if (options_.live) {
    start_dashboard();
  }
  link_->start();
  telemetry_->start();
  run_until_over();
  judge_end();
  stop_threads();
  end_view();
  if (processes_->surface_tap() != nullptr) {
    processes_->surface_tap()->record(nullptr);
  }
  if (recorder_ && recorder_->finish().surface_frames_left_out > 0) {
    note("--record-surface: " + std::to_string(recorder_->finish().surface_frames_left_out) +
         " pictures of the surface were left out, because it may have 4 MB/s and 4 GB in all");
  }
  if (recorder_ && !recorder_->finish().trouble.empty()) {
    note("--record: " + recorder_->finish().trouble);
    file_failed_ = true;
  }
  if (!telemetry_->trouble().empty()) {
    fail("the live line and the recording ended early: " + telemetry_->trouble());
  }
  if (!link_->trouble().empty()) {
    fail("the link to the simulator ended early, and the force faded to zero: " + link_->trouble());
  }
  if (device_) {
    driver::add(summary_.device_statistics, device_->statistics());
  }
  collect_counts({*link_, ports_, *telemetry_, *methods_, *watch_}, options_.method,
                 servo_options_.requests_per_s, summary_);
  write_flight_records(*telemetry_, options_.out, summary_);
  report_fault();
  report(loop_text(summary_, telemetry_->statistics()));
  finish_processes();

  ContactCycles cycles = cycles_since(link_->first_contact(), telemetry_->records());
  judge(options_, methods_->names(), why_no_reference(), link_->first_contact(), cycles, summary_);
  settle_status();
  write_files(cycles);
  report(errors_text(summary_));
  settle_status();  // a file may have failed, or a signal may have come meanwhile
  write_json(options_.json, to_json(summary_, telemetry_->statistics()).dump(2));
  return summary_.exit_status;
}

// A signal, a fault or an emergency stop ends everything.
std::optional<std::string> Run::next_scene() {
  return summary_.end == RunEnd::kScene ? next_scene_.chosen() : std::nullopt;
}

// Something on the way, for people: beside the results.
void Run::say(const std::string& text, log::Level level, const char* component) const {
  log::write(
      {level, component, text, "", out_ == stdout ? log::Where::kStdout : log::Where::kStderr});
}

// Results, of whole lines. Where they would be in the way of JSON they are messages.
void Run::report(const std::string& text) const {
  if (text.find_first_not_of('\n') == std::string::npos) {
    return;
  }
  const std::string lines = text.substr(0, text.size() - (text.ends_with('\n') ? 1 : 0));
  if (out_ == stdout) {
    std::printf("%s\n", lines.c_str());
    std::fflush(stdout);
  }
  log::write({log::Level::kInfo, "summary", lines.substr(lines.find_first_not_of('\n')), "",
              out_ == stdout ? log::Where::kFileOnly : log::Where::kStderr});
}

// The summary says it, too: on the console this is for whoever does not see that.
void Run::report_fault() const {
  if (summary_.outcome.fault == servo::Fault::kNone) {
    return;
  }
  const bool in_summary = out_ == stdout || log::console_shows(log::Level::kInfo);
  log::write({log::Level::kError, "servo", fault_text(summary_.outcome), "",
              in_summary ? log::Where::kFileOnly : log::Where::kStderr});
}

// A requested file can't be written.
void Run::fail(const std::string& text) {
  note(text);
  log::error("run", text);
  file_failed_ = true;
}

void Run::look_at_keys(milliseconds timeout) {
  if (keys_->emergency_pressed(timeout)) {
    StopRequest::request_emergency(servo::EmergencySource::kKey);
  }
}

void Run::connect() {
  processes_.emplace(options_, tool_, profile_, kept_view_);
  watch_.emplace(SimulatorWatchOptions{
      .address = processes_->simulator_address(),
      .period_s = processes_->has_simulator()
                      ? 1.0 / options_.simulator_rate_Hz + 1e-3 * options_.simulator_delay_ms
                      : 0.0,
      .timeout_s = options_.simulator_timeout_s,
      .wait = options_.wait_for_simulator,
      .has_key = !options_.key_files.empty()});
  link_.emplace(processes_->simulator_address(), ports_, processes_->take_link_keys());
  // Locking memory may take longer than the device's time-out, so it comes before opening the
  // device. The loop tries again and reports a refusal.
  static_cast<void>(rt::lock_memory());
  const std::string& url = processes_->device_url();
  if (StopRequest::stop()) {
    throw std::runtime_error("stopped before the device was opened");
  }
  device_ = open_for_run(url, profile_, firmware_, options_, realtime_refused_.empty());
  own_end_.emplace();  // until here no current was ever commanded
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
      base_profile);
  if (!calibrated_file.empty()) {
    say("Calibrated profile of this unit: " + calibrated_file);
  }
  // No force has been rendered yet; a key pressed now must prevent force later.
  keys_.emplace();
}

// False: it was stopped before. A Falcon reports whether its axes are homed and has no force
// until then.
bool Run::calibrate_arm() {
  if (options_.calibrated && is_falcon(profile_)) {
    say("Falcon: --calibrated has no effect, because the device reports whether its axes are "
        "homed");
  }
  if (options_.calibrated && !is_falcon(profile_)) {
    return true;
  }
  return driver::calibrate(
      *device_, profile_, seconds(60), [&](const std::string& text) { say(text); },
      [&] {
        look_at_keys(milliseconds(0));
        return StopRequest::stop().load();
      });
}

int Run::end_uncalibrated() {
  note("stopped before the arm was calibrated; the motors had no current");
  say(summary_.notes.back());
  summary_.outcome.zero_current_delivered = device_->stop();
  processes_->hurry_simulator();
  summary_.device_statistics = device_->statistics();
  summary_.emulator = processes_->finish_emulator();
  summary_.simulator = processes_->finish_simulator();
  summary_.reference = "the loop never ran";
  judge_end();
  settle_status();
  write_json(options_.json, to_json(summary_, servo::TelemetryStatistics{}).dump(2));
  return summary_.exit_status;
}

void Run::prepare_telemetry() {
  say("Simulator: " + processes_->simulator_address() +
      (processes_->has_simulator() ? ", scene " + options_.scene : "") + "; method " +
      options_.method + " at " + std::to_string(std::lround(options_.rate_Hz)) +
      " Hz; Ctrl-C ends it" + (keys_->active() ? ", space or e stops the motors at once" : ""));
  recorder_ = start_recorder(
      options_, profile_, methods_->names(), processes_->device_url(), device_->identity(),
      view_hello(view_title(options_, *methods_, method_options_, servo_options_, *processes_),
                 profile_, servo_options_.workspace)
          .dump());
  SurfaceTap* const tap = processes_->surface_tap();
  if (tap != nullptr) {
    tap->record(recorder_.get());
  }
  if (!processes_->has_simulator() && (tap != nullptr || view_)) {
    say("The simulator may send its surface to " +
        (tap != nullptr ? tap->socket() : processes_->view()->surface_socket()) +
        ", see docs/view_protocol.md");
  }
  if (records_trace(options_)) {
    link_->keep_samples(kRecordedSamples);
  }
  if (recorder_ || view_) {
    link_->on_sample([this](const servo::ArrivedSample& sample) {
      if (recorder_) {
        recorder_->push(sample);
      }
      if (view_) {
        view_->push(sample);
      }
    });
  }
  servo::TelemetryOptions telemetry_options;
  telemetry_options.method_names = methods_->names();
  telemetry_options.rate_Hz = options_.rate_Hz;
  telemetry_options.on_sentence = [this](const std::string& text) {
    say(text, log::Level::kInfo, "servo");
    if (view_) {
      view_->note("info", "servo", text);
    }
  };
  if (!options_.live) {
    telemetry_options.on_live_line = [this](const std::string& text) {
      say(text, log::Level::kInfo, "servo");
    };
  }
  telemetry_options.on_cycle = [this, said = false](const servo::CycleRecord& cycle) mutable {
    if (!said) {
      said = true;
      log::info("servo", "The servo loop runs: its first cycle is over.");
    }
    if (recorder_) {
      recorder_->push(cycle);
    }
    if (dashboard_) {
      dashboard_->add(cycle);
    }
    if (view_) {
      view_->push(cycle);
    }
  };
  if (view_) {
    telemetry_options.drain_interval = kViewDrain;
  }
  telemetry_.emplace(ports_, telemetry_options);
}

// Before telemetry, which the view is fed by.
void Run::start_view() {
  const ViewProcess* const process = processes_->view();
  if (process == nullptr) {
    return;
  }
  ViewTitle title =
      live_title(options_, *processes_, *methods_, method_options_, servo_options_, tool_);
  title.restart = [this](const std::string& scene) {
    next_scene_.choose(scene);
    StopRequest::request();
  };
  view_ = std::make_unique<ViewFeed>(process->feed_socket(), title, profile_,
                                     servo_options_.workspace, ports_);
  std::fputs(process->address_text().c_str(), stderr);  // not to the log: it has the token
  const std::string why_not = options_.open_view ? process->open_browser() : "";
  if (!why_not.empty()) {
    say("--open: " + why_not + "; open the address yourself", log::Level::kWarn);
  }
}

// When the devices' end is known.
void Run::end_view() {
  if (view_) {
    view_->finish(name_of(summary_.end, StopRequest::signal_name()),
                  status_of(summary_.end, StopRequest::signal()),
                  summary_.outcome.fault == servo::Fault::kNone ? "" : fault_text(summary_.outcome),
                  summary_.outcome.zero_current_delivered);
    summary_.setting_changes = view_->setting_changes();
    const rt::Percentiles delay_ms = view_->picture_delay_ms();
    if (delay_ms.count() > 0) {
      summary_.picture_delay = {delay_ms.count(), delay_ms.at(0.5), delay_ms.at(0.99)};
    }
  }
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
  to_dashboard_.emplace([this](const std::string& line) { dashboard_->note(line + "\n"); });
  keys_.emplace();
}

// Says what the simulator does, and ends the run if it has none any more.
void Run::watch_simulator() {
  if (const auto how = processes_->simulator_end()) {
    simulator_died_ = true;
    note("the simulator process " + *how + " during the run; the force faded to zero");
    say(summary_.notes.back(), log::Level::kWarn);
  }
  const std::int64_t sample_ns = link_->newest_sample_ns();
  const auto line = watch_->update(
      now_s(), sample_ns == 0 ? std::nullopt : std::optional(1e-9 * static_cast<double>(sample_ns)),
      link_->nobody_listens());
  if (line && !simulator_died_) {
    say(*line,
        watch_->state() == SimulatorWatch::State::kThere ? log::Level::kInfo : log::Level::kWarn);
  }
  // A process of this run does not come back; its force has faded when it counts as lost.
  if (watch_->gave_up() || (simulator_died_ && watch_->state() != SimulatorWatch::State::kThere)) {
    StopRequest::request();
  }
}

// Runs the loop until it ends by itself.
servo::ServoOutcome Run::run_loop(double for_s) {
  watch_->begin(now_s());
  return servo::run_watched(*loop_, StopRequest::stop(), for_s, StopRequest::request, [this] {
    look_at_keys(milliseconds(20));
    watch_simulator();
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
          std::to_string(std::lround(options_.reconnect_timeout_s)) + " s; Ctrl-C ends it.",
      log::Level::kWarn);
  Reconnect how;
  how.open = [&] {
    return open_for_run(url_again_, profile_, firmware_, options_, realtime_refused_.empty());
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
      "; the force ramps in.");
  return true;
}

// Why the loop is over; before the work after it, during which more may come.
void Run::judge_end() {
  const servo::Fault fault = summary_.outcome.fault;
  summary_.signal_name = StopRequest::signal_name();
  if (fault == servo::Fault::kEmergencyStop || StopRequest::emergency().pressed()) {
    summary_.end = RunEnd::kEmergencyStop;
  } else if (fault != servo::Fault::kNone) {
    summary_.end = RunEnd::kFault;
  } else if (StopRequest::signal() != 0) {
    summary_.end = RunEnd::kSignal;
  } else if (watch_->missing() ||
             (simulator_died_ && watch_->state() != SimulatorWatch::State::kThere)) {
    summary_.end = watch_->state() == SimulatorWatch::State::kNever ? RunEnd::kNoSimulator
                                                                    : RunEnd::kLostSimulator;
  } else if (next_scene_.chosen()) {
    summary_.end = RunEnd::kScene;
  }
}

// A signal that shortened the work after the loop counts, too, and so does a file that failed.
void Run::settle_status() {
  const int signal = StopRequest::signal();
  summary_.signal_name = StopRequest::signal_name();
  summary_.exit_status = status_of(summary_.end, signal);
  if (summary_.exit_status == 0) {
    summary_.exit_status = signal != 0 ? status_after(signal) : file_failed_ ? 1 : 0;
  }
}

void Run::stop_threads() {
  if (summary_.outcome.fault == servo::Fault::kEmergencyStop) {
    StopRequest::request_emergency(summary_.outcome.emergency);  // skips the remaining work
  }
  if (StopRequest::stop()) {
    processes_->hurry_simulator();
  }
  keys_.reset();
  link_->stop();
  telemetry_->stop();
  to_dashboard_.reset();
  dashboard_.reset();
  rt::unlock_memory();
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
    report(motors_text(*summary_.emulator));
  } else if (emulated) {
    note("the emulator wrote no report; it " + processes_->emulator_end());
    say("Note: " + summary_.notes.back(), log::Level::kWarn);
  }
  if (summary_.simulator) {
    report(workers_text(*summary_.simulator));
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
  for (const auto& change : summary_.setting_changes) {
    if (change.at("name") == "wall_mm" || change.at("name") == "cut") {
      return "none: a wall or a cut was chosen in the live view";
    }
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
    const std::vector<FigureRow> rows = figure_rows(cycles, names.size());
    summary_.files.push_back(write_figure_data(options_.out, names, rows));
    if (summary_.end == RunEnd::kScene) {
      return;  // the next run waits
    }
    for (std::string& file : draw_figures(options_.out, names, rows)) {
      summary_.files.push_back(std::move(file));
    }
  } catch (const rt::Interrupted&) {
    note("the pictures were skipped by " + StopRequest::signal_name());
  } catch (const evaluation::NoGnuplot& error) {
    note(std::string("no pictures: ") + error.what());
    say("Note: " + summary_.notes.back());
  } catch (const std::runtime_error& error) {
    fail(error.what());
  }
  if (!recorder_) {
    return;
  }
  const tools::RecorderEnd& recorded = recorder_->finish();
  if (!recorded.closed) {
    return;  // the recorder has said what went wrong and what is left
  }
  summary_.files.push_back(options_.record);
  try {
    complete_recording(*recorder_, options_.record, cycles.records, cycles.reference_W,
                       to_json(summary_, telemetry_->statistics()).dump());
  } catch (const tools::Hdf5Error& error) {
    summary_.files.pop_back();
    fail(error.what());
  }
}

}  // namespace

int run_command(const RunOptions& options) {
  std::unique_ptr<ViewProcess> view;  // outlives every run, so that pages stay connected
  RunOptions now = options;
  for (;;) {
    Run run(now, view);
    const int status = run.execute();
    const auto scene = run.next_scene();
    if (!scene) {
      return status;
    }
    now = with_scene(now, *scene);
    StopRequest::forget();
  }
}

}  // namespace forcegrid::cli
