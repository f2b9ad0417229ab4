// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run.h"

#include <cmath>
#include <stdexcept>
#include <thread>

#include "cli/common/firmware_choice.h"
#include "cli/common/stop_request.h"
#include "cli/run/recording.h"
#include "cli/run/run_checks.h"
#include "cli/run/run_collect.h"
#include "cli/run/run_device.h"
#include "cli/run/run_servo_options.h"
#include "cli/run/run_setup.h"
#include "cli/run/run_summary_json.h"
#include "cli/run/run_summary_text.h"
#include "cli/run/view_title.h"
#include "driver/calibration.h"
#include "driver/device_url.h"
#include "driver/discovery.h"
#include "rt/thread.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::cli {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kViewDrain{5};  // the view says within 20 ms that the servo has stopped

// Why this program's threads get no real-time scheduling; empty: they get it.
std::string why_not_realtime() {
  std::string reason;
  std::thread([&] { reason = rt::make_current_thread_realtime(rt::kServoPriority).reason; }).join();
  return reason;
}

}  // namespace

// With the JSON on standard output, everything for people goes to standard error.
Run::Run(const RunOptions& options, std::unique_ptr<ViewProcess>& view, SharedRun* shared)
    : options_(options),
      kept_view_(view),
      shared_(shared),
      prefix_(options.device_number > 0 ? "device " + std::to_string(options.device_number) + ": "
                                        : ""),
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
  methods_.emplace(options_, method_options_, shared_ != nullptr ? &shared_->pairs : nullptr);
  servo_options_.requests_per_s = methods_->requests_per_s(options_, tool_);
  prepare_folder(options_.out);
  check_writable(options_.json);
  check_recording(options_);

  // Reported once, here; the threads that are refused later stay silent.
  realtime_refused_ = why_not_realtime();
  if (!realtime_refused_.empty() && options_.device_number <= 1) {
    say("No real-time scheduling: " + realtime_refused_);
  }
}

void Run::touch_others(servo::ToolExchange& exchange, double stiffness_N_per_m) {
  servo::ToolTouchOptions& touch = servo_options_.tool_touch;
  touch.exchange = &exchange;
  touch.tool = static_cast<std::size_t>(options_.device_number - 1);
  touch.transport_delay_s = 1e-6 * profile_.usb.frame_period_us;
  touch.stiffness_N_per_m = stiffness_N_per_m;
  touch.shape = simulator::tool_shape(tool_);
}

int Run::execute() {
  if (!prepare()) {
    const int status = finish_uncalibrated();
    write_json(options_.json, json().dump(2));
    return status;
  }
  begin();
  render();
  finish();
  write_json(options_.json, json().dump(2));
  return summary_.exit_status;
}

nlohmann::json Run::json() const {
  return to_json(summary_, telemetry_ ? telemetry_->statistics() : servo::TelemetryStatistics{});
}

bool Run::prepare() {
  connect();
  return calibrate_arm();
}

void Run::begin() {
  start_view();
  prepare_telemetry();
  loop_.emplace(*device_, profile_, methods_->methods(), ports_, servo_options_);
  if (options_.live) {
    start_dashboard();
  }
  link_->start();
  telemetry_->start();
}

void Run::render() {
  run_until_over();
  if (shared_ != nullptr && summary_.outcome.fault != servo::Fault::kNone) {
    int none = 0;
    shared_->failed_device.compare_exchange_strong(none, options_.device_number);
    if (shared_->fault_stops_all) {
      StopRequest::request();
    }
  }
  judge_end();
  stop_threads();
}

int Run::finish() {
  if (options_.device_number > 0) {
    report("\nDevice " + std::to_string(options_.device_number) + ", " + options_.device + ":");
  }
  if (shared_ == nullptr) {
    end_view();
  }
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
  if (summary_.shared) {
    summary_.shared->others_told = link_->others_accepted();
    summary_.shared->others = link_->others();
  }
  write_flight_records(*telemetry_, options_.out, summary_);
  report_fault();
  report(loop_text(summary_, telemetry_->statistics()));
  finish_processes();

  ContactCycles cycles = cycles_since(link_->first_contact(), telemetry_->records());
  judge_forces(cycles);
  settle_status();
  write_files(cycles);
  report(errors_text(summary_));
  settle_status();  // a file may have failed, or a signal may have come meanwhile
  return summary_.exit_status;
}

// A signal, a fault or an emergency stop ends everything.
std::optional<std::string> Run::next_scene() {
  return summary_.end == RunEnd::kScene ? next_scene_.chosen() : std::nullopt;
}

// Something on the way, for people: beside the results.
void Run::say(const std::string& text, log::Level level, const char* component) const {
  log::write({level, component, prefix_ + text, "",
              out_ == stdout ? log::Where::kStdout : log::Where::kStderr});
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
  log::write({log::Level::kError, "servo", prefix_ + fault_text(summary_.outcome), "",
              in_summary ? log::Where::kFileOnly : log::Where::kStderr});
}

// A requested file can't be written.
void Run::fail(const std::string& text) {
  note(text);
  log::error("run", text);
  file_failed_ = true;
}

void Run::look_at_keys(milliseconds timeout) {
  TerminalKeys* const keys = shared_ != nullptr ? shared_->keys : &*keys_;
  if (keys == nullptr) {
    std::this_thread::sleep_for(timeout);  // another thread looks at them
  } else if (keys->emergency_pressed(timeout)) {
    StopRequest::request_emergency(servo::EmergencySource::kKey);
  }
}

void Run::connect() {
  RunOptions for_processes = options_;
  if (shared_ != nullptr && !shared_->simulator.empty()) {
    for_processes.simulator = shared_->simulator;
  }
  processes_.emplace(for_processes, tool_, profile_, kept_view_);
  watch_.emplace(SimulatorWatchOptions{
      .address = processes_->simulator_address(),
      .period_s = processes_->has_simulator()
                      ? 1.0 / options_.simulator_rate_Hz + 1e-3 * options_.simulator_delay_ms
                      : 0.0,
      .timeout_s = options_.simulator_timeout_s,
      .wait = options_.wait_for_simulator,
      .has_key = !options_.key_files.empty()});
  link_.emplace(processes_->simulator_address(), ports_, processes_->take_link_keys(),
                static_cast<link::ToolId>(options_.tool_number));
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
  if (options_.tool_number > 0) {
    const driver::DeviceIdentity& unit = device_->identity();
    SeveralTools& own = summary_.shared.emplace();
    own.tool_number = options_.tool_number;
    own.manufacturer = unit.manufacturer;
    own.product = unit.product;
    own.serial = unit.serial;
    own.url = is_emulated(options_) ? url : driver::lasting_url(url, profile_);
    own.offset_W_mm = options_.offset_W_mm;
    own.tool_stiffness_N_per_m = servo_options_.tool_touch.stiffness_N_per_m;
    link_->on_others([this](const link::OtherTools& others) {
      const std::int64_t now_ns = rt::Clock::now().time_since_epoch().count();
      for (std::size_t k = 0; k < others.count; ++k) {
        summary_.shared->others_age_ms.add(1e-6 * static_cast<double>(others.tools[k].age_ns));
        if (recorder_) {
          recorder_->push(tools::RecordedTool{now_ns, others.tools[k]});
        }
      }
    });
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
  if (shared_ == nullptr) {
    keys_.emplace();
  }
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

int Run::finish_uncalibrated() {
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
  return summary_.exit_status;
}

void Run::prepare_telemetry() {
  say("Simulator: " + processes_->simulator_address() +
      (processes_->has_simulator() ? ", scene " + options_.scene : "") + "; method " +
      options_.method + " at " + std::to_string(std::lround(options_.rate_Hz)) +
      " Hz; Ctrl-C ends it" +
      ((shared_ != nullptr ? shared_->keys->active() : keys_->active())
           ? ", space or e stops the motors at once"
           : ""));
  recorder_ = start_recorder(
      options_, profile_, methods_->names(), processes_->device_url(), device_->identity(),
      view_hello(view_title(options_, *methods_, method_options_, servo_options_, *processes_),
                 profile_, servo_options_.workspace)
          .dump());
  SurfaceTap* const tap = processes_->surface_tap();
  if (tap != nullptr) {
    tap->record(recorder_.get());
  }
  if (!options_.simulator.empty() && options_.device_number <= 1 && (tap != nullptr || view_)) {
    say("The simulator may send its surface to " +
        (tap != nullptr ? tap->socket() : processes_->view()->surface_socket()) +
        ", see docs/view_protocol.md");
  }
  if (records_trace(options_) || shared_ != nullptr) {
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
    telemetry_options.on_drained = [this] { view_->send(); };
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
  if (options_.device_number <= 1) {
    std::fputs(process->address_text().c_str(), stderr);  // not to the log: it has the token
  }
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

}  // namespace forcegrid::cli
