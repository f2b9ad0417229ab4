// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cli/common/budget_option.h"
#include "cli/common/json_target.h"
#include "cli/run/run_end.h"
#include "cli/run/tool_option.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"

namespace forcegrid::cli {

/// Options of `forcegrid run`.
struct RunOptions {
  /// All devices of one simulation, in the order of the flags; the others describe each of them.
  std::vector<std::string> devices{"emulated:woodenhaptics_v2015"};
  std::vector<std::string> device_offsets_mm;  ///< "X,Y,Z" of each; fewer: default_offsets_mm()
  /// [N/m] Between the tools of several devices; 0: they pass through each other. Nothing:
  /// kToolStiffness_N_per_m, or less where the devices ask for it.
  std::optional<double> tool_stiffness_N_per_m;
  std::string fault_stops = "all";  ///< or "one": whom a device's fault brings to zero
  int tool_number = 0;              ///< of the first device at the simulator; 0: only
  // Of one device among them; of several, run_command() sets these.
  std::string device = "emulated:woodenhaptics_v2015";
  int device_number = 0;                ///< from 1 on; 0: it is the only one
  std::array<double, 3> offset_W_mm{};  ///< of the device's origin in the scene
  /// Profile of an attached device; empty: falcon for a Falcon, else woodenhaptics_v2015.
  std::string profile;
  /// "auto": the profile that `forcegrid calibrate` wrote for this unit, if any; "none"; or a file.
  std::string calibration = "auto";
  std::string firmware;  ///< file for a Falcon that runs none; empty: none
  std::string scene = "block";
  std::string solver = "auto";  ///< of the started simulator; see simulator::choose_solver
  /// Of the started simulator; nothing: the scene as written.
  std::optional<double> material_tolerance_percent;
  std::string simulator;               ///< ADDR:PORT of a running simulator; empty: start one
  std::vector<std::string> key_files;  ///< of the link to the simulator; empty: not encrypted
  int started_tools = 1;               ///< that the started simulator serves
  int workers = 0;                     ///< processes that answer queries for the started simulator
  double simulator_timeout_s = 10.0;   ///< without samples for this long the run ends
  bool wait_for_simulator = false;     ///< instead it waits without an end
  double simulator_rate_Hz = 30.0;
  double simulator_delay_ms = 0.0;
  double simulator_jitter_ms = 0.0;
  double simulator_loss_percent = 0.0;
  /// Options on the command line that a running simulator would ignore.
  std::vector<std::string> for_started_simulator;
  ToolChoice tool;        ///< of the started simulator
  double seconds = 20.0;  ///< 0: until Ctrl-C
  double rate_Hz = 500.0;
  std::string method = kDefaultMethod;  ///< MethodVariant
  std::vector<std::string> evaluated{"forcegrid",
                                     "hold"};  ///< methods evaluated on the same path, not rendered
  int fill_budget = 1000;
  BudgetOption budget;
  std::array<int, 3> cells{49, 49, 49};
  /// Radius of influence; 0: a sixth of the workspace's longest side.
  double influence_radius_mm = 0.0;
  double unit_mm = 1.0;
  int samples_per_cell = 0;
  std::optional<double> requests_per_s;  ///< default: 120 for a method that needs requests, else 0
  bool gravity_compensation = false;
  int device_timeout_ms = 100;  ///< the device counts as failed after this silence
  bool share = false;           ///< another program may have the device open
  bool calibrated = false;      ///< the encoder counters are already valid
  std::string hand = "firm";
  std::string motion = "chirp";
  std::string wrist = "turn";
  double click_every_s = 0.0;
  bool motion_of_tool = false;  ///< no --motion was given: a sliding tool uses `stroke`
  double amplitude_mm = 10.0;
  std::uint64_t seed = 1;
  std::string frame_order = "out-first";
  std::string core;
  std::vector<std::string> faults;    ///< of the emulated device
  std::string passivity = "control";  ///< or observe, or coupling; see PassivityGuard
  double passivity_allowance_mJ = 0.3;
  double passivity_damping_N_s_per_m = 10.0;   ///< at most
  std::vector<double> coupling{1000.0, 10.0};  ///< N/m, N s/m
  /// "none", "button" or "signal": what the user must hold to get force; see DeadMan.
  std::string dead_man = "none";
  bool no_motor_check = false;  ///< skip servo::MotorCheck
  bool reconnect = false;       ///< wait for a disconnected device and continue with it
  double reconnect_timeout_s = 60.0;
  std::string out = "out";
  bool no_reference = false;
  std::string record;  ///< file to write, by its extension a trace (docs/traces.md) or a recording
                       ///< (docs/recording.md); empty: none
  bool record_surface = false;  ///< the object's surface goes into the recording, too
  std::string settings;         ///< all of these as TOML, for the recording
  std::optional<std::array<double, 3>> contact_m;  ///< where the emulated hand touches, frame D
  JsonTarget json;
  bool view = false;                        ///< show the run in a browser
  std::string view_listen = "127.0.0.1:0";  ///< ADDR:PORT of its page
  std::string view_key;                     ///< PEM file that encrypts it; empty: it is not
  bool tour = false;                        ///< the page shows the steps of a tour
  bool open_view = false;                   ///< ask the desktop to open it
  bool live = false;                        ///< a dashboard instead of a line per second
  bool text_on_stderr = false;              ///< even if the JSON goes to a file
};

/// Renders the scene through the device, then prints a summary.
/// @returns the program's exit status, see run_status_help().
/// @throws std::exception with a sentence for the user if the run can't be set up.
int run_command(const RunOptions& options);

}  // namespace forcegrid::cli
