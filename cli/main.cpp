// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <functional>
#include <new>
#include <string>

#include "cli/charts/chart_command.h"
#include "cli/charts/evaluate_command.h"
#include "cli/charts/paper_command.h"
#include "cli/commands.h"
#include "cli/common/deprecated_flags.h"
#include "cli/common/number_check.h"
#include "cli/common/option_values.h"
#include "cli/common/revision.h"
#include "cli/common/scene_option.h"
#include "cli/common/standard_output.h"
#include "cli/common/stop_request.h"
#include "cli/config_command.h"
#include "cli/device/calibrate_command.h"
#include "cli/device/devices_command.h"
#include "cli/device/doctor_command.h"
#include "cli/record_command.h"
#include "cli/run/run_flags.h"
#include "cli/scene_command.h"
#include "cli/tune_command.h"
#include "device_emulator/run_emulator.h"
#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "simulator/touch/solver_choice.h"

namespace {

using namespace forcegrid;
using namespace forcegrid::cli;

void add_emulate(CLI::App& app, EmulateOptions& o, std::function<int()>& action) {
  CLI::App& emulate = *app.add_subcommand("emulate", "Serve emulated devices over USB/IP");
  emulate
      .add_option("--device", o.devices,
                  "Profiles to serve as bus ids 1-1, 1-2, ...: " +
                      joined(profiles::available_profiles()) + ", or TOML files")
      ->required();
  emulate.add_option("--listen", o.listen, "ADDR:PORT, loopback only; port 0 takes a free one")
      ->capture_default_str();
  emulate.add_option("--hand", o.hand, "Hand that holds the arm: " + joined(hands()))
      ->check(CLI::IsMember(hands()))
      ->capture_default_str();
  emulate.add_option("--motion", o.motion, "Motion of that hand: " + joined(motions()))
      ->check(motion_check())
      ->capture_default_str();
  emulate.add_option("--amplitude-mm", o.amplitude_mm, "Amplitude of the motion")
      ->check(between(0.0, 30.0))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  emulate.add_option("--seed", o.seed, "Seed of the random motions")->capture_default_str();
  emulate.add_option("--frame-order", o.frame_order, "Bus: " + joined(frame_orders()))
      ->check(CLI::IsMember(frame_orders()))
      ->capture_default_str();
  emulate.add_option("--contact", o.contact_m, "Position where the hand touches: X,Y,Z")
      ->delimiter(',')
      ->capture_default_str()
      ->type_name("[FLOAT,FLOAT,FLOAT] m");
  emulate.add_flag("--calibrated", o.calibrated, "The encoder counters are valid from the start");
  emulate
      .add_option("--fault", o.faults,
                  "Inject a fault; may be repeated. Any fault takes when=motors (in mid-force), "
                  "when=power-up or when=SECONDS, for=SECONDS, count=N. The faults, with their own "
                  "keys and defaults:\n" +
                      emulator::fault_names_text())
      ->check(fault_check())
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  emulate.add_flag("--unsupported-weight", o.unsupported_weight,
                   "The hand does not carry the links' weight: the host compensates gravity");
  emulate.add_flag("--let-go", o.let_go,
                   "The hand keeps still and lets go 3 s after the device is calibrated or homed");
  emulate.add_option("--tip-mass", o.tip_mass_kg, "Known mass fastened to the tip")
      ->check(between(0.0, emulator::kMaxTipMass_kg))
      ->capture_default_str()
      ->type_name("FLOAT kg");
  emulate.add_flag("--random-counters", o.random_counters,
                   "The encoder counters start at random values");
  emulate.add_flag("--firmware-loaded", o.firmware_loaded,
                   "The firmware of a Falcon runs from the start");
  emulate.add_flag("--until-stdin-closes", o.until_stdin_closes,
                   "End when standard input ends, for a parent process");
  add_json(emulate, o.json);
  emulate.callback([&o, &action] { action = [&o] { return emulate_command(o); }; });
}

void add_simulate(CLI::App& app, SimulateOptions& o, std::function<int()>& action) {
  CLI::App& simulate = *app.add_subcommand("simulate", "Simulate a scene for a servo over UDP");
  simulate.add_option("--scene", o.scene, "Object: " + scene_help())
      ->check(scene_check())
      ->capture_default_str();
  simulate
      .add_option("--solver", o.solver,
                  "Solver; auto chooses by damping, size and tolerance and prints why; see "
                  "docs/solvers.md")
      ->check(CLI::IsMember(simulator::solver_names()))
      ->capture_default_str();
  simulate
      .add_option("--listen", o.listen,
                  "ADDR:PORT; without --key loopback only; port 0 takes a free one")
      ->capture_default_str();
  add_key(simulate, o.key_files,
          "Encrypt the link with this key file (forcegrid keygen); may be repeated, each servo is "
          "answered under its own key");
  simulate
      .add_option("--allow", o.allowed,
                  "Accept datagrams only from ADDR or ADDR/BITS; may be repeated")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("ADDR[/BITS]");
  simulate.add_option(
      "--workers", o.workers,
      "ADDR:PORT where 'forcegrid worker' processes connect to answer queries, under the first "
      "--key");
  simulate.add_option("--rate", o.rate_Hz, "Answers per second")
      ->check(between(1.0, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT Hz");
  simulate.add_option("--delay-ms", o.delay_ms, "Delay every answer by this much")
      ->check(between(0.0, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT ms");
  add_tool(simulate, o.tool);
  simulate.add_flag("--no-stiffness", o.no_stiffness, "Send forces without dF/dP");
  simulate
      .add_flag("--bench", o.bench,
                "Do not serve; measure each solver on the scene against its converged solution, "
                "beside plain Newton-CG and Bullet; see docs/solvers.md")
      ->configurable(false);
  simulate
      .add_flag("--until-stdin-closes", o.until_stdin_closes,
                "End when standard input ends, for a parent process")
      ->configurable(false);
  add_json(simulate, o.json);
  simulate.callback([&o, &action] { action = [&o] { return simulate_command(o); }; });
}

void add_keygen(CLI::App& app, KeygenOptions& o, std::function<int()>& action) {
  CLI::App& keygen = *app.add_subcommand(
      "keygen", "Make a key file for an encrypted link between machines, see --key");
  keygen
      .add_option("FILE", o.file, "File to write the key to; an existing file is not overwritten")
      ->required();
  keygen.callback([&o, &action] { action = [&o] { return keygen_command(o); }; });
}

void add_worker(CLI::App& app, WorkerCommandOptions& o, std::function<int()>& action) {
  CLI::App& worker = *app.add_subcommand(
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
      ->capture_default_str();
  worker
      .add_flag("--until-stdin-closes", o.until_stdin_closes,
                "End when standard input ends, for a parent process")
      ->configurable(false);
  worker.callback([&o, &action] { action = [&o] { return worker_command(o); }; });
}

void add_kinematics(CLI::App& app, KinematicsOptions& o, std::function<int()>& action) {
  CLI::App& kinematics =
      *app.add_subcommand("kinematics", "Print an arm's kinematics as JSON, in the device frame");
  kinematics
      .add_option("--profile", o.profile,
                  joined(profiles::available_profiles()) + ", or a TOML file")
      ->required();
  auto* counts = kinematics.add_option("--counts", o.counts, "Encoder counts A,B,C")
                     ->delimiter(',')
                     ->expected(3)
                     ->configurable(false);
  auto* position = kinematics.add_option("--position", o.position_m, "Position X,Y,Z in metres")
                       ->delimiter(',')
                       ->expected(3)
                       ->configurable(false);
  counts->excludes(position);
  kinematics.add_option("--force", o.force_N, "Force X,Y,Z in newtons")
      ->delimiter(',')
      ->expected(3)
      ->configurable(false);
  add_json(kinematics, o.json);
  kinematics.callback([&o, &action, counts, position] {
    if (counts->empty() && position->empty()) {
      throw CLI::RequiredError("--counts A,B,C or --position X,Y,Z");
    }
    action = [&o] { return kinematics_command(o); };
  });
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Haptic interaction with virtual elastic objects", "forcegrid"};
  app.set_version_flag("--version",
                       std::string(program_version()) + ", commit " + program_commit());
  app.require_subcommand(0, 1);  // so that a misspelt one is named; having none is an error below
  app.set_help_all_flag("--help-all", "Help of every command");
  ConfigChoice choice = find_config_choice(argc, argv);
  add_config_choice(app, choice);
  RunOptions run;
  EmulateOptions emulate;
  SimulateOptions simulate;
  KeygenOptions keygen;
  WorkerCommandOptions worker;
  KinematicsOptions kinematics;
  EvaluateOptions evaluate;
  ChartCommandOptions chart;
  PaperCommandOptions paper;
  DevicesOptions devices;
  DoctorOptions doctor;
  CalibrateOptions calibrate;
  TuneOptions tune;
  SceneOptions scene;
  ReplayOptions replay;
  PlotOptions plot;
  ConfigOptions config;
  std::vector<ConfigKey> config_keys_of_all;
  std::vector<tools::ConfigLayer> layers;
  std::function<int()> action;
  add_run(app, run, action);
  add_devices(app, devices, action);
  add_json(*app.get_subcommand("devices"), devices.json);
  add_doctor(app, doctor, action);
  add_json(*app.get_subcommand("doctor"), doctor.json);
  add_calibrate(app, calibrate, action);
  add_json(*app.get_subcommand("calibrate"), calibrate.json);
  add_tune(app, tune, action);
  add_scene(app, scene, action);
  add_json(*app.get_subcommand("tune"), tune.json);
  add_record(app, run, action);
  add_replay(app, replay, action);
  add_json(*app.get_subcommand("replay"), replay.json);
  add_plot(app, plot, action);
  add_json(*app.get_subcommand("plot"), plot.json);
  add_emulate(app, emulate, action);
  add_simulate(app, simulate, action);
  add_keygen(app, keygen, action);
  add_worker(app, worker, action);
  add_kinematics(app, kinematics, action);
  add_evaluate(app, evaluate, action);
  add_chart(app, chart, action);
  add_paper(app, paper, action);
  add_config(app, config, config_keys_of_all, layers, action);
  add_json(*app.get_subcommand("config"), config.json);
  try {
    layers = choice.none ? std::vector<tools::ConfigLayer>{} : tools::config_layers(choice.file);
    config_keys_of_all = config_keys(app, {"record"});
    apply_config(config_keys_of_all, layers);
    share_defaults(*app.get_subcommand("run"), *app.get_subcommand("record"));
  } catch (const tools::ConfigError& error) {
    std::fprintf(stderr, "forcegrid: %s\n", error.what());
    return 2;
  }
  try {
    app.parse(argc, argv);
    note_deprecated_flags(argc, argv);
    if (!action) {
      throw CLI::RequiredError(
          "a subcommand: devices, doctor, calibrate, tune, scene, run, record, replay, plot, "
          "emulate, simulate, keygen, worker, kinematics, evaluate, chart, paper or config");
    }
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? 0 : 2;
  }
  try {
    StopRequest::install();
    return status_with_output(action());
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "forcegrid: not enough memory; use fewer --cells or a smaller --r-mm\n");
    return 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid: %s\n", error.what());
    return 1;
  }
}
