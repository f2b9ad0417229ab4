// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "cli/run/tool_option.h"

namespace forcegrid::cli {

struct EmulateOptions {
  std::vector<std::string> devices;  ///< profile names or files
  std::string listen = "127.0.0.1:3240";
  std::string hand = "firm";
  std::string hand_target;
  std::string motion = "chirp";
  std::string wrist = "turn";
  double click_every_s = 0.0;
  double amplitude_mm = 10.0;
  std::uint64_t seed = 1;
  std::string frame_order = "out-first";
  std::string core;
  std::vector<std::string> faults;
  bool calibrated = false;
  bool random_counters = false;
  bool firmware_loaded = false;
  bool unsupported_weight = false;
  bool let_go = false;
  double linger_s = 0.0;
  double tip_mass_kg = 0.0;
  std::array<double, 3> contact_m{};
  bool until_stdin_closes = false;
  JsonTarget json;
};

/// Serves emulated devices until it is asked to stop, then reports what their motors did.
int emulate_command(const EmulateOptions& options);

struct SimulateOptions {
  std::string scene = "block";
  std::string solver = "auto";
  std::optional<double> material_tolerance_percent;  ///< nothing: the scene as written
  std::string listen = "127.0.0.1:24870";
  std::vector<std::string> key_files;
  std::vector<std::string> allowed;
  std::string workers;
  std::string surface;
  int tools = 1;
  std::string fault_stops = "all";
  double rate_Hz = 30.0;
  double delay_ms = 0.0;
  double jitter_ms = 0.0;
  double loss_percent = 0.0;
  std::string control;
  ToolChoice tool;
  bool no_stiffness = false;
  bool until_stdin_closes = false;
  bool bench = false;
  JsonTarget json;
};

/// Simulates a scene for a servo until it is asked to stop, then reports its timing.
int simulate_command(const SimulateOptions& options);

struct KeygenOptions {
  std::string file;
};

/// Writes a new key file for a link between machines, and prints how to use it.
int keygen_command(const KeygenOptions& options);

struct WorkerCommandOptions {
  std::string connect;
  std::string key_file;
  std::string scene = "block";
  bool until_stdin_closes = false;
};

/// Answers queries for a simulator until it is asked to stop.
int worker_command(const WorkerCommandOptions& options);

struct KinematicsOptions {
  std::string profile;
  std::vector<double> counts;
  std::vector<double> position_m;
  std::vector<double> force_N;
  JsonTarget json;
};

/// Prints the arm's kinematics at encoder counts or at a position as JSON.
int kinematics_command(const KinematicsOptions& options);

}  // namespace forcegrid::cli
