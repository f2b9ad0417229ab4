#include "cli/run_command.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <stdexcept>
#include <thread>

#include "cli/child_process.h"
#include "cli/figures.h"
#include "cli/firmware_choice.h"
#include "cli/offline_forces.h"
#include "cli/reconnect.h"
#include "cli/recording.h"
#include "cli/run_setup.h"
#include "cli/run_summary.h"
#include "cli/stop_request.h"
#include "cli/terminal_keys.h"
#include "cli/worker_processes.h"
#include "driver/calibration.h"
#include "driver/device_url.h"
#include "driver/discovery.h"
#include "driver/open_device.h"
#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "rt/thread.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/telemetry.h"
#include "simulator/direct_method.h"
#include "simulator/scene.h"
#include "simulator/truth.h"
#include "tools/dashboard.h"
#include "tools/hdf5_file.h"
#include "tools/recorder.h"
#include "tools/unit_profile.h"

namespace forcegrid::cli {
namespace {

using servo::Triple;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr char kDirect[] = "direct";
constexpr char kSlidingMotion[] = "stroke";
constexpr double kDirectShare = 0.5;  // of a cycle that method direct may take
constexpr milliseconds kChildEndTimeout{3000};
constexpr milliseconds kWatchdogProof{700};
constexpr double kDefaultRequests_per_s = 120.0;

std::optional<nlohmann::json> final_report(ChildProcess* child) {
  if (child == nullptr) {
    return std::nullopt;
  }
  const std::string text = child->finish(kChildEndTimeout);
  auto parsed = nlohmann::json::parse(text, nullptr, false);
  if (parsed.is_discarded()) {
    return std::nullopt;
  }
  return parsed;
}

// The started simulator's tool: the scene's, with what was asked for. That of a simulator that
// already runs is its own business, and taken for the default here.
simulator::ToolOptions tool_of(const RunOptions& options) {
  if (options.simulator.empty()) {
    return tool_options(options.tool, simulator::scene_tool(options.scene));
  }
  if (options.tool.given()) {
    throw std::runtime_error(tool_arguments(options.tool).front() +
                             ": the tool is the simulator's, and --simulator names one that "
                             "already runs; give it to 'forcegrid simulate'");
  }
  return {};
}

// What a tool's options don't go with.
void check_tool(const RunOptions& options, const simulator::ToolOptions& tool) {
  simulator::check_together(tool);
  if (tool.is_sticky_point()) {
    return;
  }
  const std::string asked = "tool " + tool.shape + ", contact " + tool.contact;
  if (tool.slides() && options.workers > 0) {
    throw std::runtime_error(asked +
                             ": what a sliding tool feels depends on its path, so that --workers "
                             "have nothing to answer; leave them out");
  }
  const auto is_direct = [](const std::string& method) { return method == kDirect; };
  if (is_direct(options.method) ||
      std::any_of(options.shadows.begin(), options.shadows.end(), is_direct)) {
    throw std::runtime_error(asked +
                             ": method direct knows sticky contact of a point alone; "
                             "choose another method");
  }
}

void check_solver(const RunOptions& options) {
  if (options.solver != "auto" && !options.simulator.empty()) {
    throw std::runtime_error("--solver " + options.solver +
                             ": --simulator names one that already runs; give it to 'forcegrid "
                             "simulate'");
  }
}

// The scene itself as a force method, if a servo cycle has the time for it.
std::unique_ptr<ForceMethod> make_direct(const RunOptions& options) {
  if (!options.simulator.empty()) {
    throw std::runtime_error(
        "method direct needs the object in this process, but --simulator names another one; leave "
        "that out or choose another method");
  }
  const simulator::Scene scene = simulator::make_scene(options.scene);
  if (moves_by_itself(options.scene, options.solver)) {
    throw std::runtime_error("method direct: it solves equilibria, and scene " + options.scene +
                             " moves by itself; choose another method, or --solver quasi_static");
  }
  simulator::DirectOptions direct_options;
  direct_options.patch_radius_m = scene.patch_radius_m;
  auto direct = std::make_unique<simulator::DirectMethod>(scene.mesh, direct_options);
  const double period_s = 1.0 / options.rate_Hz;
  const double cycle_s = direct->measured_cycle_s(period_s);
  if (cycle_s > kDirectShare * period_s) {
    char times[64];
    std::snprintf(times, sizeof times, "%.2f ms, more than half of the %.2f ms", 1e3 * cycle_s,
                  1e3 * period_s);
    throw std::runtime_error("method direct: one cycle of scene " + options.scene + " takes " +
                             times +
                             " that --rate leaves; use --scene small, a lower --rate, or "
                             "another method");
  }
  return direct;
}

void prepare_folder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  const std::string probe = folder + "/.writable";
  std::ofstream file(probe);
  file << "probe\n";
  file.close();
  if (error || !file) {
    throw std::runtime_error("folder '" + folder + "' for the results can't be written (" +
                             (error ? error.message() : std::strerror(errno)) +
                             "); choose another with --out");
  }
  std::filesystem::remove(probe, error);
}

std::unique_ptr<ChildProcess> start_emulator(const RunOptions& options, const std::string& motion,
                                             const std::string& profile_name, bool homes_itself) {
  std::vector<std::string> arguments = {"emulate",
                                        "--device",
                                        profile_name,
                                        "--listen",
                                        "127.0.0.1:0",
                                        "--hand",
                                        options.hand,
                                        "--motion",
                                        motion,
                                        "--amplitude-mm",
                                        std::to_string(options.amplitude_mm),
                                        "--seed",
                                        std::to_string(options.seed),
                                        "--frame-order",
                                        options.frame_order,
                                        "--until-stdin-closes",
                                        "--json"};
  if (options.calibrated && !homes_itself) {
    arguments.push_back("--calibrated");
  }
  for (const std::string& fault : options.faults) {
    arguments.insert(arguments.end(), {"--fault", fault});
  }
  if (options.contact_m) {
    const auto& at_m = *options.contact_m;
    arguments.insert(arguments.end(),
                     {"--contact", std::to_string(at_m[0]) + "," + std::to_string(at_m[1]) + "," +
                                       std::to_string(at_m[2])});
  }
  if (options.gravity_compensation) {
    arguments.push_back("--unsupported-weight");  // else two would carry it
  }
  return std::make_unique<ChildProcess>(arguments);
}

std::unique_ptr<ChildProcess> start_simulator(const RunOptions& options,
                                              const std::vector<std::string>& key_files) {
  std::vector<std::string> arguments = {"simulate",
                                        "--scene",
                                        options.scene,
                                        "--solver",
                                        options.solver,
                                        "--listen",
                                        "127.0.0.1:0",
                                        "--rate",
                                        std::to_string(options.simulator_rate_Hz),
                                        "--delay-ms",
                                        std::to_string(1e3 * options.simulator_delay_s),
                                        "--until-stdin-closes",
                                        "--json"};
  const std::vector<std::string> tool = tool_arguments(options.tool);
  arguments.insert(arguments.end(), tool.begin(), tool.end());
  for (const std::string& file : key_files) {
    arguments.insert(arguments.end(), {"--key", file});
  }
  if (options.workers > 0) {
    arguments.insert(arguments.end(), {"--workers", "127.0.0.1:0"});
  }
  return std::make_unique<ChildProcess>(arguments);
}

// With a coupling the guard observes what that gives.
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
      throw std::runtime_error(
          "--dead-man button: the only button of " + profile.name +
          " latches when it is pressed, and tells nobody whether it is held; use --dead-man signal "
          "with a switch of its own");
    }
    servo_options.dead_man = servo::DeadMan::kButton;
  } else if (options.dead_man == "signal") {
    servo_options.dead_man = servo::DeadMan::kSignal;
  }
}

std::string why_truth_is_skipped() {
  return StopRequest::emergency().pressed() ? "skipped by the emergency stop" : "skipped by Ctrl-C";
}

bool is_falcon(const profiles::DeviceProfile& profile) { return profile.usb.protocol == "falcon"; }

// Only the rendered method may ask the simulator: its shadows see what it sees along the path.
double requests_per_s(const RunOptions& options, const simulator::ToolOptions& tool,
                      const std::vector<ForceMethod*>& methods,
                      const std::vector<std::string>& names) {
  for (std::size_t i = 1; i < methods.size(); ++i) {
    if (methods[i]->needs().requests) {
      throw std::runtime_error("--shadow \"" + names[i] +
                               "\": only the rendered method's requests reach the simulator; give "
                               "it as --method");
    }
  }
  const bool needed = methods.front()->needs().requests;
  const double asked =
      options.requests_per_s.value_or(needed || options.workers > 0 ? kDefaultRequests_per_s : 0.0);
  if (needed && asked == 0.0) {
    throw std::runtime_error("--requests-per-s 0: method \"" + names.front() +
                             "\" lives on its requests; give more, or another method");
  }
  if (tool.slides() && asked > 0.0) {
    throw std::runtime_error(
        "contact slide: what a sliding tool feels depends on its path, so that "
        "requests have no answer; use a method without them, and --requests-per-s 0");
  }
  if (asked > options.rate_Hz) {
    throw std::runtime_error("--requests-per-s " + std::to_string(std::lround(asked)) +
                             ": a request a cycle at most; give a number up to --rate");
  }
  return asked;
}

// The calibrated profile of the unit that has been opened; empty: none is to be taken.
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

// Positions and forces of the cycles from the contact on.
struct ContactCycles {
  std::vector<const servo::CycleRecord*> records;
  std::vector<Eigen::Vector3d> positions_W;
};

ContactCycles cycles_since(const std::deque<servo::CycleRecord>& records, std::int64_t contact_ns) {
  ContactCycles cycles;
  for (const servo::CycleRecord& record : records) {
    if (record.time_ns >= contact_ns && record.fault == servo::Fault::kNone) {
      cycles.records.push_back(&record);
      cycles.positions_W.push_back(servo::vector(record.touching_W_m));
    }
  }
  return cycles;
}

double time_s(const servo::CycleRecord& record, std::int64_t contact_ns) {
  return 1e-9 * static_cast<double>(record.time_ns - contact_ns);
}

void add_errors(RunSummary& summary, const std::vector<std::string>& names,
                const ContactCycles& cycles, const std::vector<Eigen::Vector3d>& truth_W,
                std::int64_t contact_ns) {
  double truth_sum = 0.0;
  for (const Eigen::Vector3d& force_W : truth_W) {
    truth_sum += force_W.squaredNorm();
    summary.force_max_N = std::max(summary.force_max_N, force_W.norm());
  }
  summary.force_rms_N = std::sqrt(truth_sum / static_cast<double>(truth_W.size()));
  const auto percent = [&](double sum, double count) {
    return count > 0.0 && summary.force_rms_N > 0.0
               ? 100.0 * std::sqrt(sum / count) / summary.force_rms_N
               : 0.0;
  };
  for (std::size_t method = 0; method < names.size(); ++method) {
    double first_sum = 0.0;
    double first_count = 0.0;
    double rest_sum = 0.0;
    double rest_count = 0.0;
    double worst = 0.0;
    for (std::size_t i = 0; i < truth_W.size(); ++i) {
      const double squared =
          (servo::vector(cycles.records[i]->method_force_W_N[method]) - truth_W[i]).squaredNorm();
      if (time_s(*cycles.records[i], contact_ns) < 1.0) {
        first_sum += squared;
        first_count += 1.0;
      } else {
        rest_sum += squared;
        rest_count += 1.0;
        worst = std::max(worst, squared);
      }
    }
    MethodError error;
    error.rms_percent = percent(first_sum + rest_sum, first_count + rest_count);
    error.rms_percent_first_1s = percent(first_sum, first_count);
    error.rms_percent_after_1s = percent(rest_sum, rest_count);
    error.max_percent_after_1s = percent(worst, 1.0);
    summary.errors[names[method]] = error;
  }
}

// Shows how far the off-line forces are: on a terminal one line that is written over and over,
// elsewhere a line every quarter.
class TruthProgress {
 public:
  explicit TruthProgress(std::FILE* out) : out_(out), terminal_(isatty(fileno(out)) == 1) {}

  void operator()(double done, double remaining_s) {
    if (!terminal_ && done < next_) {
      return;
    }
    next_ += 0.25;
    std::fprintf(out_, "%sOff-line forces: %3.0f %%, %2.0f s left (Ctrl-C skips them)%s",
                 terminal_ ? "\r" : "", 100.0 * done, remaining_s,
                 terminal_ && done < 1.0 ? " " : "\n");
    std::fflush(out_);
  }

 private:
  std::FILE* out_;
  bool terminal_;
  double next_ = 0.25;
};

}  // namespace

void check_writable(const JsonTarget& target) {
  if (target.file.empty()) {
    return;
  }
  errno = 0;
  if (!std::ofstream(target.file, std::ios::app)) {
    throw std::runtime_error("--json " + target.file + " can't be written (" +
                             std::strerror(errno) + "); name a file in a folder that exists");
  }
}

void write_json(const JsonTarget& target, const std::string& text) {
  if (!target.wanted) {
    return;
  }
  if (target.file.empty()) {
    std::printf("%s\n", text.c_str());
    if (std::fflush(stdout) != 0) {
      throw std::runtime_error(std::string("standard output: ") + std::strerror(errno));
    }
    return;
  }
  errno = 0;
  std::ofstream file(target.file);
  file << text << '\n';
  file.close();
  if (!file) {
    const std::string reason = std::strerror(errno);
    std::printf("%s\n", text.c_str());  // rather here than lost
    throw std::runtime_error("--json " + target.file + ": " + reason +
                             "; the summary is on standard output instead");
  }
}

int run_command(const RunOptions& options) {
  // With the JSON on standard output, everything for people goes to standard error.
  std::FILE* const out = options.json.on_stdout() || options.text_on_stderr ? stderr : stdout;
  std::unique_ptr<tools::Dashboard> dashboard;
  const auto say = [out, &dashboard](const std::string& text) {
    if (dashboard) {
      dashboard->note(text);
      return;
    }
    std::fputs(text.c_str(), out);
    std::fflush(out);
  };
  if (options.live) {
    tools::Dashboard::check(out);
  }
  const simulator::ToolOptions tool = tool_of(options);
  check_tool(options, tool);
  check_solver(options);

  const bool emulated = options.device.rfind(kEmulatedPrefix, 0) == 0;
  const std::string profile_name = profile_name_of(options.device, options.profile);
  if (emulated && !options.profile.empty() && options.profile != profile_name) {
    throw std::runtime_error("--profile " + options.profile + " contradicts --device " +
                             options.device + "; an emulated device brings its own profile");
  }
  if (!emulated && !options.faults.empty()) {
    throw std::runtime_error("--fault " + options.faults.front() +
                             ": only an emulated device has faults on demand; use --device " +
                             "emulated:PROFILE, or give --fault to forcegrid emulate");
  }
  profiles::DeviceProfile profile = profiles::load_device_profile(profile_name);
  const driver::falcon::Firmware firmware = firmware_for(options.firmware, profile, emulated);
  if (options.gravity_compensation && profile.kind == profiles::DeviceKind::kDelta) {
    throw std::runtime_error(
        "--gravity-compensation: the masses of the Falcon's moving parts are "
        "not known; leave it out");
  }

  RunSummary summary;
  summary.device = options.device;
  summary.device_profile = profile.name;
  summary.scene = options.simulator.empty() ? options.scene : "";
  summary.method = options.method;
  summary.passivity = options.passivity;
  summary.rate_requested_Hz = options.rate_Hz;

  // The rendered method first, the others in its shadow at the same path.
  servo::ServoOptions servo_options;
  servo_options.rate_Hz = options.rate_Hz;
  servo_options.fill_budget = options.fill_budget;
  servo_options.simulator_rate_Hz = options.simulator_rate_Hz;
  servo_options.report_timeout = milliseconds(options.device_timeout_ms);
  servo_options.gravity_compensation = options.gravity_compensation;
  servo_options.check_motors = !options.no_motor_check;
  set_passivity(options, servo_options);
  set_switches(options, profile, servo_options);
  const MethodOptions base = method_options(options, profile, servo_options.workspace);
  std::vector<std::unique_ptr<ForceMethod>> owned;
  std::vector<ForceMethod*> methods;
  std::vector<std::string> names;
  const auto add_method = [&](const std::string& text) {
    if (text == kDirect && std::find(names.begin(), names.end(), text) == names.end()) {
      owned.push_back(make_direct(options));
      methods.push_back(owned.back().get());
      names.push_back(text);
    }
    if (text == kDirect) {
      return;
    }
    const MethodVariant variant = parse_method_variant(text, base);
    if (std::find(names.begin(), names.end(), variant.text) == names.end()) {
      owned.push_back(make_force_method(variant.name, variant.options));
      methods.push_back(owned.back().get());
      names.push_back(variant.text);
    }
  };
  add_method(options.method);
  for (const std::string& shadow : options.shadows) {
    add_method(shadow);
  }
  servo_options.requests_per_s = requests_per_s(options, tool, methods, names);
  prepare_folder(options.out);
  check_writable(options.json);
  check_recording(options);

  // Said once and now; the threads that are refused the same later keep silent.
  std::string realtime_refused;
  std::thread([&] {
    realtime_refused = rt::make_current_thread_realtime(rt::kServoPriority).reason;
  }).join();
  if (!realtime_refused.empty()) {
    say("No real-time scheduling: " + realtime_refused + "\n");
  }

  if (options.workers > 0 && !options.simulator.empty()) {
    throw std::runtime_error(
        "--workers are those of a simulator that is started here, but --simulator names another; "
        "start it with --workers ADDR:PORT and each worker with 'forcegrid worker'");
  }
  std::unique_ptr<WorkerProcesses> workers;
  if (options.workers > 0) {
    workers = std::make_unique<WorkerProcesses>(options.key_files);
  }
  const std::vector<std::string> key_files = workers ? workers->key_files() : options.key_files;
  std::vector<link::LinkKey> keys_of_link = link::load_keys(key_files);
  std::unique_ptr<ChildProcess> emulator;
  std::unique_ptr<ChildProcess> simulator;
  if (options.simulator.empty()) {
    simulator = start_simulator(options, key_files);
  }
  std::string url = options.device;
  if (emulated) {
    emulator = start_emulator(
        options, tool.slides() && options.motion_of_tool ? kSlidingMotion : options.motion,
        profile_name, is_falcon(profile));
    url = "usbip://" + listening_address(*emulator, "emulator") + "/1-1";
  }
  const std::string simulator_line = simulator ? listening_line(*simulator, "simulator") : "";
  if (workers) {
    workers->start(options.workers, simulator_line, options.scene);
  }
  const std::string simulator_address =
      simulator ? simulator_line.substr(0, simulator_line.find(' ')) : options.simulator;

  servo::ServoPorts ports;
  std::unique_ptr<tools::Recorder> recorder;  // before the threads that give to it
  servo::LinkThread link(simulator_address, ports, std::move(keys_of_link));
  // Filling locked memory may take longer than a device may be silent, so it comes before the
  // device. A refusal is reported by the loop, which asks again.
  static_cast<void>(rt::lock_memory());
  std::unique_ptr<driver::Device> device =
      open(url, profile, firmware, options.device_timeout_ms, realtime_refused.empty());
  const std::string base_profile = profile.name;
  const std::string calibrated_file =
      calibrated_profile(options, base_profile, device->identity(),
                         emulated ? "emulated" : driver::lasting_url(url, profile));
  if (!calibrated_file.empty()) {
    profile = profiles::load_device_profile(calibrated_file);
  }
  // Now, while it is there: where it is to be found again.
  const std::string url_again = options.reconnect ? driver::lasting_url(url, profile) : url;
  say("Device: " + device->identity().product + " (" + device->identity().manufacturer +
      ", serial " + device->identity().serial + ") at " + url + ", profile " + base_profile + "\n");
  if (!calibrated_file.empty()) {
    say("Calibrated profile of this unit: " + calibrated_file + "\n");
  }
  // No force has been rendered yet, but who presses a key now wants none later.
  std::optional<TerminalKeys> keys(std::in_place);
  const auto look_at_keys = [&](milliseconds timeout) {
    if (keys->emergency_pressed(timeout)) {
      StopRequest::request_emergency(servo::EmergencySource::kKey);
    }
  };
  // A Falcon says itself whether its axes are homed, and has no force before.
  if (options.calibrated && is_falcon(profile)) {
    say("Falcon: --calibrated changes nothing, as it says itself whether its axes are homed\n");
  }
  if (!options.calibrated || is_falcon(profile)) {
    const bool calibrated = driver::calibrate(
        *device, profile, seconds(60), [&](const std::string& text) { say(text + "\n"); },
        [&] {
          look_at_keys(milliseconds(0));
          return StopRequest::stop().load();
        });
    if (!calibrated) {
      summary.notes.push_back("stopped before the arm was calibrated; the motors had no current");
      say(summary.notes.back() + "\n");
      summary.outcome.zero_current_delivered = device->stop();
      summary.device_statistics = device->statistics();
      summary.emulator = final_report(emulator.get());
      summary.simulator = final_report(simulator.get());
      summary.truth = "the loop never ran";
      write_json(options.json, to_json(summary, servo::TelemetryStatistics{}).dump(2));
      return StopRequest::emergency().pressed() ? kEmergencyStatus : 1;
    }
  }
  say("Simulator: " + simulator_address + (simulator ? ", scene " + options.scene : "") +
      "; method " + options.method + " at " + std::to_string(std::lround(options.rate_Hz)) +
      " Hz; Ctrl-C ends it" + (keys->active() ? ", space or e stops the motors at once\n" : "\n"));

  servo::TelemetryOptions telemetry_options;
  telemetry_options.method_names = names;
  telemetry_options.rate_Hz = options.rate_Hz;
  telemetry_options.live = options.live ? nullptr : out;
  if (options.live) {
    telemetry_options.on_sentence = say;
  }
  recorder = start_recorder(options, profile, names, url, device->identity());
  if (records_trace(options)) {
    link.keep_samples(kRecordedSamples);
  }
  if (recorder) {
    link.on_sample([&](const servo::ArrivedSample& sample) { recorder->push(sample); });
  }
  if (recorder || options.live) {
    telemetry_options.on_cycle = [&](const servo::CycleRecord& cycle) {
      if (recorder) {
        recorder->push(cycle);
      }
      if (dashboard) {
        dashboard->add(cycle);
      }
    };
  }
  servo::Telemetry telemetry(ports, telemetry_options);
  servo::ServoLoop loop(*device, profile, methods, ports, servo_options);
  if (options.live) {
    std::vector<std::string> members;
    for (const char* member : methods.front()->members()) {
      members.emplace_back(member);
    }
    keys.reset();  // its signal handlers have to be newer than the dashboard's
    dashboard = std::make_unique<tools::Dashboard>(
        out, tools::DashboardTitle{options.device, simulator ? options.scene : simulator_address,
                                   options.method, members, options.rate_Hz});
    keys.emplace();
  }
  link.start();
  telemetry.start();
  bool simulator_is_gone = false;
  // Runs the loop until it ends by itself.
  const auto run_loop = [&](double for_s) {
    std::atomic<bool> ended{false};
    servo::ServoOutcome outcome;
    std::thread servo_thread([&] {
      outcome = loop.run(StopRequest::stop(), for_s);
      ended = true;
    });
    while (!ended) {
      look_at_keys(milliseconds(20));
      if (simulator && !simulator_is_gone && !simulator->running()) {
        simulator_is_gone = true;
        std::string how = simulator->abnormal_end();
        summary.notes.push_back("the simulator process " + (how.empty() ? "ended" : how) +
                                " during the run; the force faded to zero");
        say(summary.notes.back() + "\n");
      }
    }
    servo_thread.join();
    return outcome;
  };
  double left_s = options.seconds;
  for (;;) {
    const rt::TimePoint begun = rt::Clock::now();
    const std::uint64_t missed_before = summary.outcome.missed_deadlines;
    summary.outcome = run_loop(left_s);
    summary.outcome.missed_deadlines += missed_before;
    const rt::TimePoint ended = rt::Clock::now();
    left_s -= options.seconds > 0.0 ? rt::seconds(ended - begun) : 0.0;
    const servo::Fault fault = summary.outcome.fault;
    if (!options.reconnect || !servo::may_be_over_after_reconnecting(fault) ||
        StopRequest::stop() || (options.seconds > 0.0 && left_s <= 0.0)) {
      break;
    }
    say(servo::sentence_for(fault) + " (" + summary.outcome.device_failure +
        ")\nWaiting for the device, at most " +
        std::to_string(std::lround(options.reconnect_timeout_s)) + " s; Ctrl-C ends it.\n");
    Reconnect how;
    how.open = [&] {
      return open(url_again, profile, firmware, options.device_timeout_ms,
                  realtime_refused.empty());
    };
    how.cancelled = [&] {
      look_at_keys(milliseconds(0));
      return StopRequest::stop().load();
    };
    how.say = say;
    how.profile = &profile;
    how.before = device->identity();
    how.last_counts = device->newest_report().counts;
    how.may_calibrate = !options.calibrated || is_falcon(profile);
    how.timeout = rt::from_seconds(options.reconnect_timeout_s);
    driver::add(summary.device_statistics, device->statistics());
    device.reset();
    Reconnected again = reconnect(how);
    if (!again.device) {
      summary.notes.push_back("not connected again: " + again.why_not);
      break;
    }
    device = std::move(again.device);
    loop.continue_with(*device);
    summary.recovered.push_back(
        {fault, summary.outcome.device_failure, ended.time_since_epoch().count()});
    summary.recalibrations += again.recalibrated ? 1 : 0;
    say("The device is back" +
        std::string(again.recalibrated ? " and calibrated" : ", its counters are as they were") +
        "; the force ramps in.\n");
  }
  if (summary.outcome.fault == servo::Fault::kEmergencyStop) {
    StopRequest::request_emergency(summary.outcome.emergency);  // what is left to do can wait
  }
  StopRequest::main_part_is_over();
  keys.reset();
  link.stop();
  telemetry.stop();
  dashboard.reset();
  rt::unlock_memory();
  const bool emergency =
      summary.outcome.fault == servo::Fault::kEmergencyStop || StopRequest::emergency().pressed();
  int status = summary.outcome.fault == servo::Fault::kNone ? 0 : 1;
  if (recorder && !recorder->finish().trouble.empty()) {
    summary.notes.push_back("--record: " + recorder->finish().trouble);
    status = 1;
  }

  if (!summary.outcome.memory_lock_refused.empty()) {
    summary.notes.push_back(summary.outcome.memory_lock_refused);
  }
  if (!summary.outcome.awake_refused.empty()) {
    summary.notes.push_back(summary.outcome.awake_refused);
  }
  if (device) {
    driver::add(summary.device_statistics, device->statistics());
  }
  summary.link = link.statistics();
  summary.samples_received = link.samples_accepted();
  summary.simulator_clock = link.simulator_clock();
  summary.samples_not_converged = link.samples_not_converged();
  summary.worst_relative_residual = link.worst_relative_residual();
  summary.worst_solve_time_s = link.worst_solve_time_s();
  summary.records_lost = ports.records_lost.load();
  summary.samples_overrun = link.samples_lost();
  const auto& records = telemetry.records();
  if (records.size() > 1) {
    summary.elapsed_s =
        1e-9 * static_cast<double>(records.back().time_ns - telemetry.first_time_ns());
  }
  if (servo_options.requests_per_s > 0.0 && summary.outcome.requests_made == 0) {
    summary.notes.push_back("method " + options.method + " made no request");
  }
  if (link.samples_accepted() == 0) {
    summary.notes.push_back("no sample came from " + simulator_address +
                            "; is a simulator listening there" +
                            (options.key_files.empty() ? "?" : " that has this key?"));
  }
  const auto write_flight_record = [&](const std::string& name, std::int64_t end_ns) {
    const std::string flight = options.out + "/" + name;
    try {
      telemetry.write_flight_record(flight, servo::Telemetry::kFlightRecord_s, end_ns);
      summary.files.push_back(flight);
    } catch (const std::runtime_error& error) {
      summary.notes.push_back(error.what());
    }
  };
  for (std::size_t i = 0; i < summary.recovered.size(); ++i) {
    write_flight_record("flight_record_" + std::to_string(i + 1) + ".csv",
                        summary.recovered[i].time_ns);
  }
  if (summary.outcome.fault != servo::Fault::kNone) {
    write_flight_record("flight_record.csv", std::numeric_limits<std::int64_t>::max());
  }
  summary.cycles_kept = records.size();
  if (summary.cycles_kept < telemetry.statistics().cycles) {
    summary.notes.push_back("only the last " + std::to_string(summary.cycles_kept) +
                            " cycles were kept; errors, CSV and picture are theirs");
  }
  for (const NamedCounter& counter : methods.front()->counters()) {
    summary.counters[counter.name] = counter.value;
  }
  for (const char* member : methods.front()->members()) {
    summary.members.emplace_back(member);
  }
  say(loop_text(summary, telemetry.statistics()));

  if (emulated && !summary.outcome.zero_current_delivered) {
    // The proof is left to the device's own watchdog, which needs half a second.
    std::this_thread::sleep_for(kWatchdogProof);
  }
  summary.emulator = final_report(emulator.get());
  summary.simulator = final_report(simulator.get());
  if (summary.emulator) {
    say(motors_text(*summary.emulator));
  } else if (emulated) {
    const std::string how = emulator->abnormal_end();
    summary.notes.push_back("the emulator gave no report; it " + (how.empty() ? "is gone" : how));
    say("Note: " + summary.notes.back() + "\n");
  }
  if (summary.simulator) {
    say(workers_text(*summary.simulator));
  }

  // The off-line forces: the same object, converged, at every measured position since the contact.
  const auto contact = link.first_contact();
  ContactCycles cycles;
  if (contact) {
    cycles = cycles_since(records, contact->time_ns);
  }
  std::vector<Eigen::Vector3d> truth_W;
  if (!contact || cycles.records.size() < 2) {
    summary.truth = "the tool never touched the object";
  } else if (!simulator) {
    summary.truth = "only the scenes of 'forcegrid simulate' can be solved off line";
  } else if (tool.slides()) {
    summary.truth = "none: what a sliding tool feels depends on its path";
  } else if (options.no_truth) {
    summary.truth = "skipped by --no-truth";
  } else if (StopRequest::hurry()) {
    summary.truth = why_truth_is_skipped();
  } else {
    simulator::TruthOptions truth_options;
    truth_options.scene = options.scene;
    truth_options.contact_point_W = contact->point_W;
    truth_options.cancel = &StopRequest::hurry();
    truth_options.progress = TruthProgress(out);
    std::vector<double> times_s;
    for (const servo::CycleRecord* record : cycles.records) {
      times_s.push_back(time_s(*record, contact->time_ns));
    }
    const simulator::TruthResult truth =
        solve_offline_forces(options.solver, cycles.positions_W, times_s, truth_options);
    if (truth.cancelled) {
      summary.truth = why_truth_is_skipped();
    } else {
      truth_W = truth.forces_W;
      summary.truth = "computed";
      summary.truth_details = truth.to_json();
      if (truth.unconverged > 0) {
        summary.notes.push_back(std::to_string(truth.unconverged) +
                                " off-line forces did not reach their tolerance");
      }
      add_errors(summary, names, cycles, truth_W, contact->time_ns);
    }
  }

  std::vector<FigureRow> rows;
  for (std::size_t i = 0; i < cycles.records.size(); ++i) {
    FigureRow row;
    row.time_s = time_s(*cycles.records[i], contact->time_ns);
    row.position_W_m = cycles.records[i]->touching_W_m;
    if (!truth_W.empty()) {
      row.truth_W_N = servo::triple(truth_W[i]);
    }
    for (std::size_t method = 0; method < names.size(); ++method) {
      row.method_W_N.push_back(cycles.records[i]->method_force_W_N[method]);
    }
    rows.push_back(std::move(row));
  }
  try {
    if (records_trace(options)) {
      if (truth_W.empty()) {
        throw std::runtime_error("no trace was recorded in " + options.record +
                                 ", for want of off-line forces: " + summary.truth);
      }
      evaluation::write_trace(options.record,
                              trace_of(link.samples(), cycles.records, truth_W, contact->time_ns));
      summary.files.push_back(options.record);
    }
  } catch (const std::runtime_error& error) {
    summary.notes.push_back(error.what());
    std::fprintf(stderr, "forcegrid: %s\n", error.what());
    status = 1;
  }
  try {
    for (std::string& file : write_figures(options.out, names, rows)) {
      summary.files.push_back(std::move(file));
    }
  } catch (const std::runtime_error& error) {
    summary.notes.push_back(error.what());
    std::fprintf(stderr, "forcegrid: %s\n", error.what());
    status = 1;
  }
  if (recorder) {
    summary.files.push_back(options.record);
  }
  if (recorder && recorder->finish().closed) {
    try {
      complete_recording(*recorder, options.record, cycles.records, truth_W,
                         to_json(summary, telemetry.statistics()).dump());
    } catch (const tools::Hdf5Error& error) {
      summary.notes.push_back(error.what());
      std::fprintf(stderr, "forcegrid: %s\n", error.what());
      status = 1;
    }
  }
  say(errors_text(summary));
  write_json(options.json, to_json(summary, telemetry.statistics()).dump(2));
  return emergency ? kEmergencyStatus : status;
}

}  // namespace forcegrid::cli
