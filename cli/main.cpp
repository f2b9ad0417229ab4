#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <functional>
#include <new>
#include <string>

#include "cli/calibrate_command.h"
#include "cli/chart_command.h"
#include "cli/commands.h"
#include "cli/config_command.h"
#include "cli/devices_command.h"
#include "cli/doctor_command.h"
#include "cli/evaluate_command.h"
#include "cli/number_check.h"
#include "cli/paper_command.h"
#include "cli/record_command.h"
#include "cli/revision.h"
#include "cli/run_command.h"
#include "cli/scene_command.h"
#include "cli/scene_option.h"
#include "cli/standard_output.h"
#include "cli/stop_request.h"
#include "cli/tune_command.h"
#include "device_emulator/fault_spec.h"
#include "device_emulator/run_emulator.h"
#include "driver/device_url.h"
#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "simulator/solver_choice.h"
#include "tools/recording.h"

namespace {

using namespace forcegrid;
using namespace forcegrid::cli;

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

// A method's name with options that can be understood.
CLI::Validator method_variant() {
  return CLI::Validator(
      [](std::string& input) {
        if (input == "direct") {  // of the simulator, not one of forcegrid/
          return std::string();
        }
        try {
          MethodOptions base;
          base.grid.max_W.setConstant(0.1);
          base.grid.cells.setConstant(10);
          parse_method_variant(input, base);
          return std::string();
        } catch (const std::invalid_argument& error) {
          return std::string(error.what());
        }
      },
      "METHOD [KEY=VALUE...]");
}

// What an emulated device shall do wrong.
CLI::Validator fault_spec() {
  return CLI::Validator(
      [](std::string& input) {
        try {
          static_cast<void>(emulator::parse_fault(input));
          return std::string();
        } catch (const std::invalid_argument& error) {
          return std::string(error.what());
        }
      },
      "NAME[:KEY=VALUE,...]");
}

// `--json [FILE]` of every command.
void add_json(CLI::App& command, JsonTarget& target) {
  command
      .add_option_function<std::vector<std::string>>(
          "--json",
          [&target](const std::vector<std::string>& values) {
            target.wanted = true;
            if (!values.empty() && values.front() != "{}") {
              target.file = values.front();
            }
          },
          "Summary as JSON, into FILE or to standard output")
      ->expected(0, 1)
      ->type_name("[FILE]")
      ->configurable(false)
      ->trigger_on_parse();
}

const std::vector<std::string> kMotions = {"chirp", "lissajous", "random", "poke",
                                           "hold",  "still",     "stroke"};
const std::vector<std::string> kHands = {"firm", "light", "none"};
const std::vector<std::string> kFrameOrders = {"out-first", "in-first"};

// `--key FILE` of both ends of the link: the file's name, as what is in it is for no command line.
void add_key(CLI::App& command, std::vector<std::string>& files, const std::string& description) {
  command.add_option("--key", files, description)
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("FILE");
}

// A motion by its name, or path:FILE.
CLI::Validator motion() {
  return CLI::Validator(
      [](std::string& input) {
        const bool known =
            std::find(kMotions.begin(), kMotions.end(), input) != kMotions.end() ||
            (input.starts_with("path:") && input.size() > std::string("path:").size());
        return known ? std::string()
                     : "'" + input + "' is no motion; use " + joined(kMotions) + ", path:FILE";
      },
      "{" + joined(kMotions) + ", path:FILE}");
}

CLI::App& add_run_as(const char* name, const char* what, CLI::App& app, RunOptions& o,
                     std::function<int()>& action) {
  CLI::App& run = *app.add_subcommand(name, what);
  run.add_option(
         "--device", o.device,
         "emulated:PROFILE, or an attached device:\n" + std::string(driver::device_url_forms()))
      ->capture_default_str();
  run.add_option("--profile", o.profile,
                 "Profile of an attached device (default falcon for a Falcon, else "
                 "woodenhaptics_v2015): " +
                     joined(profiles::available_profiles()) + ", or a TOML file");
  run.add_option(
         "--calibration", o.calibration,
         "Profile of this very unit: auto takes what forcegrid calibrate has written for it, "
         "none does not, else a TOML file")
      ->capture_default_str();
  run.add_option("--firmware", o.firmware,
                 "Firmware file for a Novint Falcon in which none runs (always after power-on); an "
                 "emulated one gets a synthetic image by default");
  run.add_option("--scene", o.scene, "Object to feel: " + scene_help())
      ->check(scene_check())
      ->capture_default_str();
  run.add_option("--solver", o.solver,
                 "How the simulator solves the scene, as of 'forcegrid simulate'")
      ->check(CLI::IsMember(simulator::solver_names()))
      ->capture_default_str();
  run.add_option("--simulator", o.simulator,
                 "ADDR:PORT of a simulator that already runs, instead of --scene; on another "
                 "machine only with --key");
  add_key(run, o.key_files, "Seal the link to the simulator with this key file (forcegrid keygen)");
  run.add_option("--seconds", o.seconds, "How long; 0 runs until Ctrl-C")
      ->check(between(0.0, 86400.0))
      ->capture_default_str()
      ->type_name("FLOAT s");
  run.add_option("--method", o.method,
                 "Force method: " + joined(method_names()) +
                     ", direct; changes to its options may follow, e.g. \"forcegrid unit=m s=3\"")
      ->check(method_variant())
      ->capture_default_str();
  run.add_option("--shadow", o.shadows,
                 "Methods that run beside it, judged on the same path but not felt")
      ->delimiter(';')
      ->check(method_variant())
      ->capture_default_str();
  run.add_option("--rate", o.rate_Hz, "Servo rate in Hz")
      ->check(between(100.0, 4000.0))
      ->capture_default_str()
      ->type_name("FLOAT Hz");
  run.add_option("--fill-budget", o.fill_budget, "Vertices a cycle and method may update")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str()
      ->type_name("INT vertices");
  run.add_option("--cells", o.cells, "Grid cells an axis: X,Y,Z")
      ->delimiter(',')
      ->check(CLI::Range(1, 4096))
      ->capture_default_str()
      ->type_name("[INT,INT,INT] cells");
  run.add_option("--r-mm", o.influence_radius_mm,
                 "Distance of influence r; 0 is a sixth of the workspace's longest side")
      ->check(between(0.0, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  run.add_option("--unit-mm", o.unit_mm, "Unit of length in the grid's weight")
      ->check(between(0.001, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  run.add_option("--s", o.samples_per_cell, "Samples a cell counts at most; 0 counts all")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str()
      ->type_name("INT samples");
  run.add_option("--requests-per-s", o.requests_per_s,
                 "Forces at positions of its own choice that the method may ask the simulator for "
                 "(default 120 for a method that needs them, else 0)")
      ->check(between(0.0, 4000.0))
      ->type_name("FLOAT 1/s");
  run.add_flag("--gravity-compensation", o.gravity_compensation, "Carry the links' weight");
  run.add_option("--device-timeout-ms", o.device_timeout_ms,
                 "Silence of the device after which the run ends with zero current; its own "
                 "watchdog waits 500 ms")
      ->check(CLI::Range(10, 450))
      ->capture_default_str()
      ->type_name("INT ms");
  run.add_flag("--calibrated", o.calibrated,
               "The counters are right already; ask for no button (a Falcon is homed anyway)");
  run.add_option("--sim-rate", o.simulator_rate_Hz, "Answers a second of the started simulator")
      ->check(between(1.0, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT Hz");
  run.add_option("--workers", o.workers,
                 "Processes that answer requests for the started simulator; default then 120 "
                 "requests a second")
      ->check(CLI::Range(0, 64))
      ->capture_default_str()
      ->type_name("INT processes");
  run.add_option_function<double>(
         "--sim-delay-ms", [&o](double ms) { o.simulator_delay_s = 1e-3 * ms; },
         "Hold each answer of the started simulator back this long")
      ->default_str("0")
      ->check(between(0.0, 1000.0))
      ->type_name("FLOAT ms");
  add_tool(run, o.tool);
  run.add_option("--hand", o.hand, "Emulated hand: " + joined(kHands))
      ->check(CLI::IsMember(kHands))
      ->capture_default_str();
  run.add_option("--motion", o.motion,
                 "Motion of the emulated hand: " + joined(kMotions) +
                     "; unless given, stroke with a tool that slides")
      ->check(motion())
      ->capture_default_str();
  run.add_option("--amplitude-mm", o.amplitude_mm, "Amplitude of the motion")
      ->check(between(0.0, 30.0))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  run.add_option("--seed", o.seed, "Seed of the random motions")->capture_default_str();
  run.add_option("--frame-order", o.frame_order, "Emulated bus: " + joined(kFrameOrders))
      ->check(CLI::IsMember(kFrameOrders))
      ->capture_default_str();
  run.add_option(
         "--fault", o.faults,
         "Make the emulated device misbehave; may be repeated, see forcegrid emulate --help")
      ->check(fault_spec())
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  run.add_option("--passivity", o.passivity,
                 "What is done about energy that the force gives to the hand: control (damp it), "
                 "observe (only count it), coupling (touch through a spring and damper)")
      ->check(CLI::IsMember({"control", "observe", "coupling"}))
      ->capture_default_str();
  run.add_option("--passivity-allowance-mJ", o.passivity_allowance_mJ,
                 "Energy in a contact from which on the control acts, in mJ")
      ->check(between(0.01, 1000.0))
      ->type_name("FLOAT mJ")
      ->capture_default_str();
  run.add_option("--passivity-damping", o.passivity_damping_N_s_per_m,
                 "Most damping that the control adds, in N s/m; at most what the profile allows")
      ->check(between(0.0, 100.0))
      ->type_name("FLOAT N s/m")
      ->capture_default_str();
  run.add_option("--coupling", o.coupling, "Of --passivity coupling: K,B in N/m and N s/m")
      ->delimiter(',')
      ->expected(2)
      ->check(between(0.001, 1e6))
      ->type_name("FLOAT N/m and N s/m")
      ->capture_default_str();
  run.add_option("--dead-man", o.dead_man,
                 "Force only while this is held: button (any on a Falcon's grip), signal (SIGUSR2 "
                 "at least every 0.2 s, from a switch of its own), none")
      ->check(CLI::IsMember({"none", "button", "signal"}))
      ->capture_default_str();
  run.add_flag("--no-motor-check", o.no_motor_check,
               "Do not give each motor a few short pushes before the first force");
  run.add_flag("--reconnect", o.reconnect,
               "When the device vanishes or falls silent, wait for it and go on");
  run.add_option("--reconnect-timeout", o.reconnect_timeout_s,
                 "How long to wait for it, in seconds")
      ->check(between(0.0, 86400.0))
      ->capture_default_str()
      ->type_name("FLOAT s");
  run.add_flag("--live", o.live,
               "A dashboard in the terminal (80 x 24 is enough) instead of a line a second");
  run.add_option("--out", o.out, "Folder for the CSV, the picture and the flight record")
      ->capture_default_str();
  run.add_flag("--no-truth", o.no_truth, "Skip the off-line forces");
  run.add_option("--record", o.record,
                 "FILE.h5: everything of every cycle, as forcegrid record. FILE.csv or .csv.gz: "
                 "trace for 'forcegrid evaluate', samples and, at every cycle, position and "
                 "off-line force");
  add_json(run, o.json);
  run.callback([&run, &o, &action] {
    o.motion_of_tool = o.motion == RunOptions().motion && run.count("--motion") == 0;
    for (const char* option : {"--scene", "--sim-delay-ms"}) {
      if (run.count(option) > 0) {
        o.for_started_simulator.emplace_back(option);
      }
    }
    o.settings = run.config_to_str(true);
    action = [&o] { return run_command(o); };
  });
  return run;
}

void add_run(CLI::App& app, RunOptions& o, std::function<int()>& action) {
  add_run_as("run", "Feel a scene through a device", app, o, action);
}

// `run` with a file to record to; its settings are those of [run].
void add_record(CLI::App& app, RunOptions& o, std::function<int()>& action) {
  CLI::App& record =
      add_run_as("record", "Feel a scene and record every cycle to HDF5, see docs/recording.md",
                 app, o, action);
  record.remove_option(record.get_option("--record"));
  record.add_option("FILE", o.record, "Recording to write, FILE.h5")
      ->required()
      ->check(CLI::Validator(
          [](std::string& input) {
            return tools::is_recording_name(input)
                       ? std::string()
                       : "'" + input + "' does not end in .h5 or .hdf5, as a recording's name does";
          },
          "FILE.h5"));
}

void add_emulate(CLI::App& app, EmulateOptions& o, std::function<int()>& action) {
  CLI::App& emulate = *app.add_subcommand("emulate", "Serve emulated devices over USB/IP");
  emulate
      .add_option("--device", o.devices,
                  "Profiles to serve as 1-1, 1-2, ...: " + joined(profiles::available_profiles()) +
                      ", or TOML files")
      ->required();
  emulate.add_option("--listen", o.listen, "ADDR:PORT, loopback only; port 0 takes a free one")
      ->capture_default_str();
  emulate.add_option("--hand", o.hand, "Who holds the arm: " + joined(kHands))
      ->check(CLI::IsMember(kHands))
      ->capture_default_str();
  emulate.add_option("--motion", o.motion, "What that hand does: " + joined(kMotions))
      ->check(motion())
      ->capture_default_str();
  emulate.add_option("--amplitude-mm", o.amplitude_mm, "Amplitude of the motion")
      ->check(between(0.0, 30.0))
      ->capture_default_str()
      ->type_name("FLOAT mm");
  emulate.add_option("--seed", o.seed, "Seed of the random motions")->capture_default_str();
  emulate.add_option("--frame-order", o.frame_order, "Bus: " + joined(kFrameOrders))
      ->check(CLI::IsMember(kFrameOrders))
      ->capture_default_str();
  emulate.add_option("--contact", o.contact_m, "Where the hand goes to touch: X,Y,Z in metres")
      ->delimiter(',')
      ->capture_default_str()
      ->type_name("[FLOAT,FLOAT,FLOAT] m");
  emulate.add_flag("--calibrated", o.calibrated, "Counters are right from the start");
  emulate
      .add_option("--fault", o.faults,
                  "Misbehave; may be repeated. Any fault takes when=motors (in mid-force), "
                  "when=power-up or when=SECONDS, for=SECONDS, count=N. The faults, with their own "
                  "keys and defaults:\n" +
                      emulator::fault_names_text())
      ->check(fault_spec())
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  emulate.add_flag("--unsupported-weight", o.unsupported_weight,
                   "The hand does not bear the links' weight: the host compensates gravity");
  emulate.add_flag("--let-go", o.let_go,
                   "The hand keeps still, and lets go 3 s after the device is calibrated or homed");
  emulate.add_option("--tip-mass", o.tip_mass_kg, "A known mass that is fastened to the tip")
      ->check(between(0.0, emulator::kMaxTipMass_kg))
      ->capture_default_str()
      ->type_name("FLOAT kg");
  emulate.add_flag("--random-counters", o.random_counters, "Counters start anywhere");
  emulate.add_flag("--firmware-loaded", o.firmware_loaded,
                   "A Falcon's firmware runs from the start");
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
      .add_option(
          "--solver", o.solver,
          "How the object is solved; auto picks by damping, size and tolerance and says why; see "
          "docs/solvers.md")
      ->check(CLI::IsMember(simulator::solver_names()))
      ->capture_default_str();
  simulate
      .add_option("--listen", o.listen,
                  "ADDR:PORT; without --key loopback only; port 0 takes a free one")
      ->capture_default_str();
  add_key(simulate, o.key_files,
          "Seal the link with this key file (forcegrid keygen); may be repeated, each servo is "
          "answered under its own");
  simulate
      .add_option("--allow", o.allowed,
                  "Take datagrams only from ADDR or ADDR/BITS; may be repeated")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->type_name("ADDR[/BITS]");
  simulate.add_option(
      "--workers", o.workers,
      "Let 'forcegrid worker' processes at ADDR:PORT answer queries, by the first --key");
  simulate.add_option("--rate", o.rate_Hz, "Answers a second")
      ->check(between(1.0, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT Hz");
  simulate.add_option("--delay-ms", o.delay_ms, "Hold each answer back this long")
      ->check(between(0.0, 1000.0))
      ->capture_default_str()
      ->type_name("FLOAT ms");
  add_tool(simulate, o.tool);
  simulate.add_flag("--no-stiffness", o.no_stiffness, "Send forces without dF/dP");
  simulate
      .add_flag("--bench", o.bench,
                "Serve nobody; measure each solver on the scene against its converged solution, "
                "and beside plain Newton-CG and Bullet; see docs/solvers.md")
      ->configurable(false);
  simulate
      .add_flag("--until-stdin-closes", o.until_stdin_closes,
                "End when standard input ends, for a parent process")
      ->configurable(false);
  add_json(simulate, o.json);
  simulate.callback([&o, &action] { action = [&o] { return simulate_command(o); }; });
}

void add_keygen(CLI::App& app, KeygenOptions& o, std::function<int()>& action) {
  CLI::App& keygen =
      *app.add_subcommand("keygen", "Make a key for a link between machines, see --key");
  keygen.add_option("FILE", o.file, "New file for the key; none is overwritten")->required();
  keygen.callback([&o, &action] { action = [&o] { return keygen_command(o); }; });
}

void add_worker(CLI::App& app, WorkerCommandOptions& o, std::function<int()>& action) {
  CLI::App& worker = *app.add_subcommand(
      "worker", "Answer queries for a simulator, on this machine or another one");
  worker
      .add_option("--connect", o.connect, "tcp://ADDR:PORT, as 'forcegrid simulate --workers' says")
      ->required();
  worker.add_option("--key", o.key_file, "Key file of that simulator (forcegrid keygen)")
      ->required()
      ->type_name("FILE");
  worker.add_option("--scene", o.scene, "That simulator's object: " + scene_help())
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
  app.require_subcommand(0, 1);  // so that a misspelt one is named; none is refused below
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
