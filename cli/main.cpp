// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <exception>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "cli/commands.h"
#include "cli/common/deprecated_flags.h"
#include "cli/common/log_options.h"
#include "cli/common/number_check.h"
#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "cli/common/revision.h"
#include "cli/common/scene_option.h"
#include "cli/common/standard_output.h"
#include "cli/common/stop_request.h"
#include "cli/common/stop_watchdog.h"
#include "cli/config_command.h"
#include "cli/device/devices_command.h"
#include "cli/device/doctor_command.h"
#include "cli/exec_command.h"
#include "cli/playback/view_command.h"
#include "cli/run/run_flags.h"
#include "cli/scene_command.h"
#include "cli/tools_program.h"
#include "device_emulator/run_emulator.h"
#include "forcegrid/methods.h"
#include "log/log.h"
#include "profiles/device_profile.h"
#include "rt/checkpoint.h"
#include "simulator/touch/solver_choice.h"

namespace {

using namespace forcegrid;
using namespace forcegrid::cli;

void add_emulate(Command& app, EmulateOptions& o, std::function<int()>& action) {
  Command& emulate = app.add_subcommand("emulate", "Serve emulated devices over USB/IP");
  emulate
      .add_option("--device", o.devices,
                  "Profiles to serve, those of the first one's USB speed as bus ids 1-1, 1-2, ..., "
                  "others as 2-1, ...: " +
                      joined(profiles::available_profiles()) + ", or TOML files")
      ->required();
  emulate.add_option("--listen", o.listen, "ADDR:PORT, loopback only; port 0 takes a free one")
      ->show_default();
  emulate.add_option("--hand", o.hand, "Hand that holds the arm: " + joined(hands()))
      ->check(one_of(hands()))
      ->show_default();
  emulate
      .add_option("--hand-target", o.hand_target,
                  "Bind a Unix datagram socket that takes where the hand is wanted: three "
                  "little-endian 64-bit floats, X, Y, Z in metres; three NaN let go; see "
                  "docs/devices.md")
      ->type_name("PATH")
      ->not_in_config();
  emulate.add_option("--motion", o.motion, "Motion of that hand: " + joined(motions()))
      ->check(motion_check())
      ->show_default();
  emulate
      .add_option(
          "--wrist", o.wrist,
          "How the hand turns the wrist of a device that has one: " + joined(wrist_motions()))
      ->check(one_of(wrist_motions()))
      ->show_default();
  emulate
      .add_option("--click-every", o.click_every_s,
                  "The hand presses the button on the stylus this often; 0 means never")
      ->check(between(0.0, emulator::kMaxClickEvery_s))
      ->show_default()
      ->type_name("FLOAT s");
  emulate.add_option("--amplitude-mm", o.amplitude_mm, "Amplitude of the motion")
      ->check(between(0.0, 30.0))
      ->show_default()
      ->type_name("FLOAT mm");
  emulate.add_option("--seed", o.seed, "Seed of the random motions")
      ->check(seed_number())
      ->show_default();
  emulate.add_option("--frame-order", o.frame_order, "Bus: " + joined(frame_orders()))
      ->check(one_of(frame_orders()))
      ->show_default();
  emulate
      .add_option(
          "--core", o.core,
          "The arm's motors are driven by a second processor, such as an emulated one; this "
          "is the Unix socket of its line (docs/firmware.md)")
      ->type_name("PATH")
      ->not_in_config();
  emulate.add_option("--contact", o.contact_m, "Position where the hand touches: X,Y,Z")
      ->separated_by(',')
      ->check(finite_number())
      ->show_default()
      ->type_name("[FLOAT,FLOAT,FLOAT] m");
  emulate.add_flag("--calibrated", o.calibrated, "The encoder counters are valid from the start");
  emulate
      .add_option("--fault", o.faults,
                  "Inject a fault; may be repeated. Any fault takes when=motors (in mid-force), "
                  "when=power-up or when=SECONDS, for=SECONDS, count=N. The faults, with their own "
                  "keys and defaults:\n" +
                      emulator::fault_names_text())
      ->check(fault_check())
      ->repeatable();
  emulate.add_flag("--unsupported-weight", o.unsupported_weight,
                   "The hand does not carry the links' weight: the host compensates gravity");
  emulate.add_flag("--let-go", o.let_go,
                   "The hand keeps still and lets go 3 s after the device is calibrated or homed");
  emulate.add_option("--tip-mass", o.tip_mass_kg, "Known mass fastened to the tip")
      ->check(between(0.0, emulator::kMaxTipMass_kg))
      ->show_default()
      ->type_name("FLOAT kg");
  emulate.add_flag("--random-counters", o.random_counters,
                   "The encoder counters start at random values");
  emulate.add_flag("--firmware-loaded", o.firmware_loaded,
                   "The firmware of a Falcon runs from the start");
  emulate.add_flag("--until-stdin-closes", o.until_stdin_closes,
                   "End when standard input ends, for a parent process");
  emulate
      .add_option(
          "--linger", o.linger_s,
          "After standard input has ended go on for so long, to tell what the firmware does "
          "without its host")
      ->check(between(0.0, emulator::kMaxLinger_s))
      ->show_default()
      ->type_name("FLOAT s");
  add_json(emulate, o.json);
  emulate.callback([&o, &action] { action = [&o] { return emulate_command(o); }; });
}

void add_simulate(Command& app, SimulateOptions& o, std::function<int()>& action) {
  Command& simulate = app.add_subcommand("simulate", "Simulate a scene for a servo over UDP");
  simulate.add_option("--scene", o.scene, "Object: " + scene_help())
      ->check(scene_check())
      ->show_default();
  simulate
      .add_option("--solver", o.solver,
                  "Solver; auto chooses by damping, size and tolerance and prints why; see "
                  "docs/solvers.md")
      ->check(one_of(simulator::solver_names()))
      ->show_default();
  simulate
      .add_option("--material-tolerance-percent", o.material_tolerance_percent,
                  "Simulate the cheapest model of the scene's finite elements whose force is "
                  "within this of the scene as written: another energy, a coarser mesh, a part of "
                  "the object; see docs/solvers.md")
      ->check(between(1e-4, 100.0))
      ->type_name("FLOAT %");
  simulate
      .add_option("--listen", o.listen,
                  "ADDR:PORT; without --key loopback only; port 0 takes a free one")
      ->show_default();
  add_key(simulate, o.key_files,
          "Encrypt the link with this key file (forcegrid keygen); may be repeated, each servo is "
          "answered under its own key");
  simulate
      .add_option("--allow", o.allowed,
                  "Accept datagrams only from ADDR or ADDR/BITS; may be repeated")
      ->repeatable()
      ->type_name("ADDR[/BITS]");
  simulate.add_option(
      "--workers", o.workers,
      "ADDR:PORT where 'forcegrid worker' processes connect to answer queries, under the first "
      "--key");
  simulate
      .add_option("--tools", o.tools,
                  "Tools that hold the object at once, each moved by a 'forcegrid run' with a "
                  "tool number of its own; several need tools that stick and the solver "
                  "quasi_static")
      ->check(whole_between(1, 4))
      ->show_default()
      ->type_name("INT tools");
  simulate
      .add_option("--fault-stops", o.fault_stops,
                  "Of several tools: whom the failure of one tool's device, or its silence, brings "
                  "to zero force, all or one")
      ->check(one_of({"all", "one"}))
      ->show_default();
  simulate.add_option("--rate", o.rate_Hz, "Answers per second")
      ->check(between(1.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT Hz");
  simulate.add_option("--delay-ms", o.delay_ms, "Delay every answer by this much")
      ->check(between(0.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT ms");
  simulate
      .add_option("--jitter-ms", o.jitter_ms,
                  "Delay every answer further, by a random time of up to this much")
      ->check(between(0.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT ms");
  simulate.add_option("--loss-percent", o.loss_percent, "Lose this share of the answers")
      ->check(between(0.0, 100.0))
      ->show_default()
      ->type_name("FLOAT %");
  add_tool(simulate, o.tool);
  simulate
      .add_option("--control", o.control,
                  "Bind a Unix datagram socket that takes another rate, delay, jitter or loss "
                  "while it runs; see docs/view_protocol.md")
      ->type_name("PATH")
      ->not_in_config();
  simulate
      .add_option("--surface", o.surface,
                  "Unix socket of the live view (FOLDER/surface of forcegrid-view), which gets the "
                  "surface as it deforms")
      ->type_name("PATH")
      ->not_in_config();
  simulate.add_flag("--no-stiffness", o.no_stiffness, "Send forces without dF/dP");
  simulate
      .add_flag("--bench", o.bench,
                "Do not serve; measure each solver on the scene against its converged solution, "
                "beside plain Newton-CG and Bullet; see docs/solvers.md")
      ->not_in_config();
  simulate
      .add_flag("--until-stdin-closes", o.until_stdin_closes,
                "End when standard input ends, for a parent process")
      ->not_in_config();
  add_json(simulate, o.json);
  simulate.callback([&o, &action] { action = [&o] { return simulate_command(o); }; });
}

void add_keygen(Command& app, KeygenOptions& o, std::function<int()>& action) {
  Command& keygen = app.add_subcommand(
      "keygen", "Make a key file for an encrypted link between machines, see --key");
  keygen
      .add_option("FILE", o.file, "File to write the key to; an existing file is not overwritten")
      ->required();
  keygen.callback([&o, &action] { action = [&o] { return keygen_command(o); }; });
}

void add_worker(Command& app, WorkerCommandOptions& o, std::function<int()>& action) {
  Command& worker = app.add_subcommand(
      "worker", "Answer queries for a simulator, on this machine or another one");
  worker
      .add_option("--connect", o.connect,
                  "tcp://ADDR:PORT that 'forcegrid simulate --workers' prints")
      ->required();
  worker.add_option("--key", o.key_file, "Key file of that simulator (forcegrid keygen)")
      ->required()
      ->type_name("FILE");
  worker.add_option("--scene", o.scene, "Object of that simulator: " + scene_help())
      ->check(scene_check())
      ->show_default();
  worker
      .add_flag("--until-stdin-closes", o.until_stdin_closes,
                "End when standard input ends, for a parent process")
      ->not_in_config();
  worker.callback([&o, &action] { action = [&o] { return worker_command(o); }; });
}

void add_kinematics(Command& app, KinematicsOptions& o, std::function<int()>& action) {
  Command& kinematics =
      app.add_subcommand("kinematics", "Print an arm's kinematics as JSON, in the device frame");
  kinematics
      .add_option("--profile", o.profile,
                  joined(profiles::available_profiles()) + ", or a TOML file")
      ->required();
  auto* counts = kinematics.add_option("--counts", o.counts, "Encoder counts A,B,C")
                     ->separated_by(',')
                     ->values(3)
                     ->check(finite_number())
                     ->not_in_config();
  auto* position = kinematics.add_option("--position", o.position_m, "Position X,Y,Z in metres")
                       ->separated_by(',')
                       ->values(3)
                       ->check(finite_number())
                       ->not_in_config();
  counts->excludes(position);
  kinematics.add_option("--force", o.force_N, "Force X,Y,Z in newtons")
      ->separated_by(',')
      ->values(3)
      ->check(finite_number())
      ->not_in_config();
  add_json(kinematics, o.json);
  kinematics.callback([&o, &action, counts, position] {
    if (!counts->given() && !position->given()) {
      throw OptionError("--counts A,B,C or --position X,Y,Z is required");
    }
    action = [&o] { return kinematics_command(o); };
  });
}

// Runs the command. After a signal the exit status tells of it, whatever the command had finished
// by then.
// @param judges_its_end  the command's own status already does, and may tell of a fault instead.
// @param silent  a parent process speaks for this one.
int perform(const std::function<int()>& action, bool judges_its_end, bool silent) {
  std::string stopped_with;
  try {
    const rt::Supervised supervised({.stop = &StopRequest::stop()});
    const int status = status_with_output(action());
    if (StopRequest::signal() == 0 || judges_its_end) {
      return status;
    }
  } catch (const std::exception& error) {
    const bool no_memory = dynamic_cast<const std::bad_alloc*>(&error) != nullptr;
    const std::string what =
        no_memory ? "not enough memory; use fewer --cells or a smaller --r-mm" : error.what();
    if (StopRequest::signal() == 0) {
      log::error("command", what);
      return 1;
    }
    stopped_with = after_stopped(what);
  }
  if (!silent) {
    say_stopped(stopped_with);
  }
  return status_after(StopRequest::signal());
}

// @throws std::runtime_error if the log's file can't be written, naming who asked for it.
void begin_log(const LogChoice& choice, const std::vector<ConfigKey>& keys, const Program& app,
               const std::vector<std::string>& words) {
  std::string command = std::string(program_version()) + ", commit " + program_commit() + ":";
  for (const std::string& word : words) {
    command += " " + word;
  }
  try {
    start_log(choice, command);
  } catch (const std::runtime_error& error) {
    const auto key = std::find_if(keys.begin(), keys.end(),
                                  [](const ConfigKey& one) { return one.name == "log.file"; });
    const bool by_flag = app.given("--log-file") || key == keys.end();
    throw std::runtime_error((by_flag ? "--log-file" : where_from(*key)) + ": " + error.what());
  }
}

int program(int argc, char** argv) {
  Program app("Haptic interaction with virtual elastic objects", "forcegrid",
              std::string(program_version()) + ", commit " + program_commit());
  ExecOptions exec;
  exec.command = take_command_of_exec(argc, argv);
  ConfigChoice choice = find_config_choice(argc, argv);
  add_config_choice(app, choice);
  LogChoice log_choice;
  add_log_options(app, log_choice);
  RunOptions run;
  EmulateOptions emulate;
  SimulateOptions simulate;
  KeygenOptions keygen;
  WorkerCommandOptions worker;
  KinematicsOptions kinematics;
  DevicesOptions devices;
  DoctorOptions doctor;
  SceneOptions scene;
  ViewOptions view;
  ConfigOptions config;
  std::vector<ConfigKey> config_keys_of_all;
  std::vector<tools::ConfigLayer> layers;
  std::function<int()> action;
  add_run(app, run, action);
  add_devices(app, devices, action);
  add_json(app.subcommand("devices"), devices.json);
  add_doctor(app, doctor, action);
  add_json(app.subcommand("doctor"), doctor.json);
  add_scene(app, scene, action);
  add_record(app, run, action);
  add_view(app, view, action);
  add_json(app.subcommand("view"), view.json);
  add_emulate(app, emulate, action);
  add_simulate(app, simulate, action);
  add_keygen(app, keygen, action);
  add_worker(app, worker, action);
  add_kinematics(app, kinematics, action);
  add_exec(app, exec, action);
  const std::shared_ptr<void> tools_options = add_tools_commands(app, action);
  add_config(app, config, config_keys_of_all, layers, action);
  add_json(app.subcommand("config"), config.json);
  try {
    layers = choice.none ? std::vector<tools::ConfigLayer>{} : tools::config_layers(choice.file);
    config_keys_of_all = config_keys(app, {"record"});
    for (const tools::ConfigLayer& layer : layers) {
      log::debug("config", layer.name + " configuration: " + layer.file);
    }
    apply_config(config_keys_of_all, layers);
    apply_environment(config_keys_of_all);
    share_defaults(app.subcommand("run"), app.subcommand("record"));
  } catch (const tools::ConfigError& error) {
    log::error("config", error.what());
    return 2;
  }
  app.callback([&action] {
    if (!action) {
      throw OptionError(
          "A subcommand is required: devices, doctor, calibrate, tune, scene, run, record, view, "
          "replay, plot, emulate, simulate, keygen, worker, kinematics, exec, evaluate, chart, "
          "paper, "
          "completion, "
          "man-pages or config");
    }
  });
  if (const std::optional<int> status = app.parse(argc, argv)) {
    return *status;
  }
  begin_log(log_choice, config_keys_of_all, app, {argv, argv + argc});
  note_deprecated_flags(argc, argv);
  StopRequest::install();
  const bool silent =
      emulate.until_stdin_closes || simulate.until_stdin_closes || worker.until_stdin_closes;
  const StopWatchdog watchdog(silent);
  bool judges_its_end = false;
  for (const char* command : {"run", "record", "replay"}) {
    judges_its_end = judges_its_end || app.subcommand(command).given();
  }
  return perform(action, judges_its_end, silent);
}

}  // namespace

int main(int argc, char** argv) {
  int status = 1;
  try {
    if (const std::optional<int> elsewhere = become_tools_program(argc, argv)) {
      return *elsewhere;
    }
    log::hold();
    status = program(argc, argv);
  } catch (const std::exception& error) {
    log::error("command", error.what());
  } catch (...) {
    log::error("command", "ended by an exception that says nothing");
  }
  log::finish();
  return status;
}
