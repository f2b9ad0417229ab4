// SPDX-License-Identifier: Apache-2.0
#include "cli/commands.h"

#include <unistd.h>

#include <functional>
#include <iostream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "cli/common/progress_line.h"
#include "cli/common/stop_request.h"
#include "cli/tools_program.h"
#include "device_emulator/run_emulator.h"
#include "driver/kinematics_json.h"
#include "link/key.h"
#include "log/log.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/scene.h"
#include "simulator/run_simulator.h"
#include "simulator/workers/worker.h"

namespace forcegrid::cli {
namespace {

std::array<double, 3> three(const std::vector<double>& values) {
  return {values.at(0), values.at(1), values.at(2)};
}

// What run_simulator() and run_worker() are told to say their steps to.
std::function<void(const std::string&)> step_shown_by(WorkProgress& work) {
  return [&work](const std::string& what) { what.empty() ? work.end() : work.begin(what); };
}

}  // namespace

int emulate_command(const EmulateOptions& options) {
  emulator::EmulatorOptions emulator;
  emulator.profiles = options.devices;
  emulator.listen = options.listen;
  emulator.hand = options.hand;
  emulator.hand_target = options.hand_target;
  emulator.motion = options.motion;
  emulator.wrist = options.wrist;
  emulator.click_every_s = options.click_every_s;
  emulator.amplitude_m = 1e-3 * options.amplitude_mm;
  emulator.seed = options.seed;
  emulator.frame_order = options.frame_order;
  emulator.core = options.core;
  emulator.faults = options.faults;
  emulator.calibrated = options.calibrated;
  emulator.hand_carries_weight = !options.unsupported_weight;
  emulator.hand_lets_go = options.let_go;
  emulator.tip_mass_kg = options.tip_mass_kg;
  emulator.random_power_up_counters = options.random_counters;
  emulator.firmware_loaded = options.firmware_loaded;
  emulator.contact_m = options.contact_m;
  emulator.linger_s = options.linger_s;
  // A parent process reports for all its children that real-time scheduling is refused.
  emulator.says_scheduling = !options.until_stdin_closes;
  const auto reports = emulator::run_emulator(emulator, std::cout, StopRequest::stop(),
                                              options.until_stdin_closes ? STDIN_FILENO : -1);
  const nlohmann::json json =
      reports.size() == 1 ? nlohmann::json(reports.front()) : nlohmann::json(reports);
  write_json(options.json, json.dump(2));
  return 0;
}

int simulate_command(const SimulateOptions& options) {
  if (options.bench) {
    return bench_command(options.scene, options.json);
  }
  simulator::SimulatorOptions simulator;
  simulator.scene = options.scene;
  simulator.solver_kind = simulator::parse_solver(options.solver);
  simulator.material_tolerance_percent = options.material_tolerance_percent;
  simulator.listen = options.listen;
  simulator.key_files = options.key_files;
  simulator.allowed = options.allowed;
  simulator.workers = options.workers;
  simulator.surface = options.surface;
  simulator.tools = static_cast<std::size_t>(options.tools);
  simulator.fault_stops_all = options.fault_stops == "all";
  simulator.rate_Hz = options.rate_Hz;
  simulator.link_conditions = {1e-3 * options.delay_ms, 1e-3 * options.jitter_ms,
                               1e-2 * options.loss_percent};
  simulator.control = options.control;
  simulator.say_loading = options.until_stdin_closes;
  simulator.send_stiffness = !options.no_stiffness;
  simulator.tool = tool_options(options.tool, simulator::scene_tool(options.scene));
  if (const std::string flags = flags_of_no_use(options.tool, *simulator.tool); !flags.empty()) {
    std::ostringstream text;
    text << "Note: " << flags << ": no effect on tool " << simulator.tool->shape << ", contact "
         << simulator.tool->contact;
    log::info("simulator", text.str());
  }
  ProgressLine line;
  WorkProgress work(line);
  if (!options.until_stdin_closes) {  // a parent process shows its own
    simulator.step = step_shown_by(work);
  }
  const simulator::SimulatorSummary summary = simulator::run_simulator(
      simulator, std::cout, StopRequest::stop(), options.until_stdin_closes ? STDIN_FILENO : -1);
  write_json(options.json, simulator::to_json(summary).dump(2));
  return 0;
}

int keygen_command(const KeygenOptions& options) {
  const link::KeyId id = link::LinkKey::generate(options.file);
  std::cout
      << "Wrote " << options.file << ", key " << link::to_string(id)
      << ", readable only by you. Copy it to the other machine over a secure channel, and give "
         "'--key "
      << options.file << "' to 'forcegrid simulate' there and to 'forcegrid run' here."
      << std::endl;
  return 0;
}

int worker_command(const WorkerCommandOptions& options) {
  simulator::WorkerOptions worker;
  worker.connect = options.connect;
  worker.key_file = options.key_file;
  worker.scene = options.scene;
  worker.say_loading = options.until_stdin_closes;
  ProgressLine line;
  WorkProgress work(line);
  if (!options.until_stdin_closes) {
    worker.step = step_shown_by(work);
  }
  const std::uint64_t answered = simulator::run_worker(
      worker, std::cout, StopRequest::stop(), options.until_stdin_closes ? STDIN_FILENO : -1);
  std::cout << "answered " << answered << " queries" << std::endl;
  return 0;
}

int kinematics_command(const KinematicsOptions& options) {
  const profiles::DeviceProfile profile = profiles::load_device_profile(options.profile);
  const std::array<double, 3> force_N =
      options.force_N.empty() ? std::array<double, 3>{} : three(options.force_N);
  JsonTarget target = options.json;
  target.wanted = true;
  if (!options.counts.empty()) {
    write_json(target,
               driver::kinematics_json_from_counts(profile, three(options.counts), force_N));
  } else {
    write_json(target,
               driver::kinematics_json_from_position(profile, three(options.position_m), force_N));
  }
  return 0;
}

}  // namespace forcegrid::cli
