// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_checks.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "cli/run/run_methods.h"
#include "cli/run/run_setup.h"
#include "simulator/mesh/scene.h"

namespace forcegrid::cli {
namespace {

// Rejects options that exclude a sliding or extended tool.
void check_tool(const RunOptions& options, const simulator::ToolOptions& tool) {
  simulator::check_together(tool);
  if (tool.is_sticky_point()) {
    return;
  }
  const std::string asked =
      "tool " + tool.shape + ", contact " + tool.contact + (tool.turns ? ", --tool-turns" : "");
  if (tool.slides() && options.workers > 0) {
    throw std::runtime_error(asked +
                             ": the force on a sliding tool depends on its path, which --workers "
                             "do not know; leave them out");
  }
  if (tool.turns && options.workers > 0) {
    throw std::runtime_error(asked + ": --workers know a tool that stays upright; leave them out");
  }
  const auto is_direct = [](const std::string& method) { return method == kDirect; };
  if (is_direct(options.method) ||
      std::any_of(options.evaluated.begin(), options.evaluated.end(), is_direct)) {
    throw std::runtime_error(
        asked + ": method direct supports only sticky contact of a point; choose another method");
  }
}

void check_solver(const RunOptions& options) {
  if (options.material_tolerance_percent && options.workers > 0) {
    throw std::runtime_error(
        "--material-tolerance-percent: workers know the scene as written; leave --workers out");
  }
  if (options.material_tolerance_percent && options.method == kDirect) {
    throw std::runtime_error(
        "--material-tolerance-percent: method direct solves the scene as written; choose another "
        "method");
  }
  if (!options.for_started_simulator.empty() && !options.simulator.empty()) {
    throw std::runtime_error(options.for_started_simulator.front() +
                             ": --simulator names a running simulator, which has its own scene and "
                             "delay; give this option to 'forcegrid simulate'");
  }
  if (options.solver != "auto" && !options.simulator.empty()) {
    throw std::runtime_error(
        "--solver " + options.solver +
        ": --simulator names a running simulator; give this option to 'forcegrid simulate'");
  }
}

void check_device(const RunOptions& options, const profiles::DeviceProfile& profile) {
  if (is_emulated(options) && !options.profile.empty() &&
      options.profile != profile_name_of(options.device, options.profile)) {
    throw std::runtime_error("--profile " + options.profile + " contradicts --device " +
                             options.device + "; an emulated device brings its own profile");
  }
  if (!is_emulated(options) && !options.faults.empty()) {
    throw std::runtime_error("--fault " + options.faults.front() +
                             ": only an emulated device can have injected faults; use --device " +
                             "emulated:PROFILE, or give --fault to forcegrid emulate");
  }
  if (!options.core.empty() &&
      (!is_emulated(options) || profile.kind == profiles::DeviceKind::kDelta)) {
    throw std::runtime_error(
        "--core: only an emulated arm has a second processor; use --device "
        "emulated:woodenhaptics_v2015");
  }
  if (options.gravity_compensation && profile.kind == profiles::DeviceKind::kDelta) {
    throw std::runtime_error(
        "--gravity-compensation: the masses of the Falcon's moving parts are "
        "not known; leave it out");
  }
}

void check_tour(const RunOptions& options) {
  if (!options.tour) {
    return;
  }
  if (!is_emulated(options) || !options.simulator.empty()) {
    throw std::runtime_error(
        "--tour: its steps change hand, scene and link, so it needs an emulated device and the "
        "simulator that run starts; leave out --device and --simulator");
  }
  if (!options.record.empty()) {
    throw std::runtime_error("--tour: a recording has one scene; leave out --record");
  }
}

void check_workers(const RunOptions& options) {
  if (options.workers > 0 && !options.simulator.empty()) {
    throw std::runtime_error(
        "--workers serve a simulator that this command starts, but --simulator names another one; "
        "start that one with --workers ADDR:PORT and each worker with 'forcegrid worker'");
  }
}

}  // namespace

bool is_emulated(const RunOptions& options) {
  return options.device.rfind(kEmulatedPrefix, 0) == 0;
}

bool is_falcon(const profiles::DeviceProfile& profile) { return profile.usb.protocol == "falcon"; }

simulator::ToolOptions tool_of(const RunOptions& options) {
  if (options.simulator.empty()) {
    return tool_options(options.tool, simulator::scene_tool(options.scene));
  }
  if (options.tool.given()) {
    throw std::runtime_error(tool_arguments(options.tool).front() +
                             ": the simulator chooses the tool, and --simulator names a running "
                             "one; give this option to 'forcegrid simulate'");
  }
  return {};
}

void check_together(const RunOptions& options, const simulator::ToolOptions& tool,
                    const profiles::DeviceProfile& profile) {
  check_tool(options, tool);
  check_solver(options);
  check_device(options, profile);
  check_workers(options);
  check_tour(options);
}

void prepare_folder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  const std::string probe = folder + "/.writable";
  std::ofstream file(probe);
  file << "probe\n";
  file.close();
  if (error || !file) {
    throw std::runtime_error("folder '" + folder + "' for the results is not writable (" +
                             (error ? error.message() : std::strerror(errno)) +
                             "); choose another with --out");
  }
  std::filesystem::remove(probe, error);
}

}  // namespace forcegrid::cli
