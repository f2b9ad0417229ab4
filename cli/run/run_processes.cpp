// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_processes.h"

#include "cli/common/stop_request.h"
#include "cli/run/run_checks.h"
#include "cli/run/run_setup.h"
#include "cli/run/tool_option.h"

namespace forcegrid::cli {
namespace {

constexpr char kSlidingMotion[] = "stroke";
constexpr std::chrono::milliseconds kChildEndTimeout{3000};

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

std::unique_ptr<ChildProcess> start_emulator(const RunOptions& options, const std::string& motion,
                                             const std::string& profile_name, bool homes_itself,
                                             const ViewProcess* view) {
  std::vector<std::string> arguments = {"emulate",
                                        "--device",
                                        profile_name,
                                        "--listen",
                                        "127.0.0.1:0",
                                        "--hand",
                                        options.hand,
                                        "--motion",
                                        motion,
                                        "--wrist",
                                        options.wrist,
                                        "--click-every",
                                        std::to_string(options.click_every_s),
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
  if (!options.core.empty()) {
    arguments.insert(arguments.end(), {"--core", options.core});
  }
  if (options.contact_m) {
    const auto& at_m = *options.contact_m;
    arguments.insert(arguments.end(),
                     {"--contact", std::to_string(at_m[0]) + "," + std::to_string(at_m[1]) + "," +
                                       std::to_string(at_m[2])});
  }
  if (view != nullptr) {
    arguments.insert(arguments.end(), {"--hand-target", view->hand_socket(options.device_number)});
  }
  if (options.gravity_compensation) {
    arguments.push_back("--unsupported-weight");  // otherwise both would carry it
  }
  return std::make_unique<ChildProcess>(arguments, ChildOptions{.name = "emulator"});
}

std::unique_ptr<ChildProcess> start_simulator(const RunOptions& options,
                                              const std::vector<std::string>& key_files,
                                              const std::string& surface_socket,
                                              const ViewProcess* view) {
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
                                        std::to_string(options.simulator_delay_ms),
                                        "--jitter-ms",
                                        std::to_string(options.simulator_jitter_ms),
                                        "--loss-percent",
                                        std::to_string(options.simulator_loss_percent),
                                        "--until-stdin-closes",
                                        "--json"};
  const std::vector<std::string> tool = tool_arguments(options.tool);
  arguments.insert(arguments.end(), tool.begin(), tool.end());
  for (const std::string& file : key_files) {
    arguments.insert(arguments.end(), {"--key", file});
  }
  if (options.started_tools > 1) {
    arguments.insert(arguments.end(), {"--tools", std::to_string(options.started_tools),
                                       "--fault-stops", options.fault_stops});
  }
  if (options.material_tolerance_percent) {
    arguments.insert(arguments.end(), {"--material-tolerance-percent",
                                       std::to_string(*options.material_tolerance_percent)});
  }
  if (!surface_socket.empty()) {
    arguments.insert(arguments.end(), {"--surface", surface_socket});
  }
  if (view != nullptr && options.started_tools == 1) {
    arguments.insert(arguments.end(), {"--control", view->simulator_socket()});
  }
  if (options.workers > 0) {
    arguments.insert(arguments.end(), {"--workers", "127.0.0.1:0"});
  }
  return std::make_unique<ChildProcess>(arguments, ChildOptions{.name = "simulator"});
}

}  // namespace

RunProcesses::RunProcesses(const RunOptions& options, const simulator::ToolOptions& tool,
                           const profiles::DeviceProfile& profile,
                           std::unique_ptr<ViewProcess>& view)
    : key_files_(options.key_files),
      device_url_(options.device),
      simulator_address_(options.simulator) {
  if (options.workers > 0) {
    workers_ = std::make_unique<WorkerProcesses>(options.key_files);
    key_files_ = workers_->key_files();
  }
  link_keys_ = link::load_keys(key_files_);
  try {
    start(options, tool, profile, view);
  } catch (...) {
    end_all();
    throw;
  }
}

RunProcesses::~RunProcesses() { end_all(); }

// After a signal all of them at the same time: each may need a moment.
void RunProcesses::end_all() noexcept {
  if (StopRequest::signal() == 0) {
    return;
  }
  for (ChildProcess* child : {simulator_.get(), emulator_.get()}) {
    if (child != nullptr) {
      child->terminate();
    }
  }
}

void RunProcesses::start(const RunOptions& options, const simulator::ToolOptions& tool,
                         const profiles::DeviceProfile& profile,
                         std::unique_ptr<ViewProcess>& view) {
  if (options.view) {
    if (!view) {
      view = std::make_unique<ViewProcess>(options.view_listen, options.view_key);
    }
    view_ = view.get();
  }
  std::string surface_socket = view_ ? view_->surface_socket() : "";
  if (options.record_surface) {
    surface_tap_ = std::make_unique<SurfaceTap>(surface_socket);
    surface_socket = surface_tap_->socket();
  }
  if (options.simulator.empty()) {
    simulator_ = start_simulator(options, key_files_, surface_socket, view_);
  }
  if (is_emulated(options)) {
    const bool slides = tool.slides() && options.motion_of_tool;
    emulator_ =
        start_emulator(options, slides ? kSlidingMotion : options.motion,
                       profile_name_of(options.device, options.profile), is_falcon(profile), view_);
    device_url_ = "usbip://" + listening_address(*emulator_) + "/1-1";
  }
  if (simulator_) {
    const std::string line = listening_line(*simulator_);
    simulator_address_ = line.substr(0, line.find(' '));
    if (workers_) {
      workers_->start(options.workers, line, options.scene);
    }
  }
}

std::optional<std::string> RunProcesses::simulator_end() {
  if (!simulator_ || simulator_end_reported_ || simulator_->running()) {
    return std::nullopt;
  }
  simulator_end_reported_ = true;
  const std::string how = simulator_->abnormal_end();
  return how.empty() ? "ended" : how;
}

void RunProcesses::hurry_simulator() noexcept {
  if (simulator_) {
    simulator_->terminate();
  }
}

std::optional<nlohmann::json> RunProcesses::finish_emulator() {
  return final_report(emulator_.get());
}

std::optional<nlohmann::json> RunProcesses::finish_simulator() {
  return final_report(simulator_.get());
}

std::string RunProcesses::emulator_end() {
  const std::string how = emulator_ ? emulator_->abnormal_end() : "";
  return how.empty() ? "is gone" : how;
}

}  // namespace forcegrid::cli
