// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_flags.h"

#include <string>

#include "cli/common/budget_option.h"
#include "cli/common/number_check.h"
#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "cli/common/scene_option.h"
#include "cli/run/run_devices.h"
#include "cli/run/tool_option.h"
#include "driver/device_url.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "profiles/device_profile.h"
#include "simulator/touch/solver_choice.h"
#include "tools/recording.h"

namespace forcegrid::cli {
namespace {

constexpr double kMostClickEvery_s = 3600.0;  // the emulator takes no more
constexpr char kTourScene[] = "small";        // light enough for a laptop that draws by software

void add_device(Command& run, RunOptions& o) {
  run.begin_group("Device");
  run.add_option(
         "--device", o.devices,
         "emulated:PROFILE, or an attached device; repeated up to four times they share one "
         "object, see docs/several_devices.md:\n" +
             std::string(driver::device_url_forms()))
      ->repeatable()
      ->show_default(o.devices.front());
  run.add_option("--device-offset-mm", o.device_offsets_mm,
                 "Where the device's origin is in the scene; repeated, of each --device in turn "
                 "(default 0,0,0; several devices 30 mm apart from left to right)")
      ->repeatable()
      ->check(offset_check());
  run.add_option("--tool-stiffness-N-per-m", o.tool_stiffness_N_per_m,
                 "Between the tools of several devices where they touch each other; 0: they pass "
                 "through (default: 200, or what the devices' hands and rates allow if that is "
                 "less)")
      ->check(between(0.0, kLargestToolStiffness_N_per_m))
      ->type_name("FLOAT N/m");
  run.add_option("--fault-stops", o.fault_stops,
                 "Of several devices: whom a fault of one brings to zero force, all or one")
      ->check(one_of({"all", "one"}))
      ->show_default();
  run.add_option("--profile", o.profile,
                 "Profile of an attached device (default falcon for a Falcon, else "
                 "woodenhaptics_v2015): " +
                     joined(profiles::available_profiles()) + ", or a TOML file");
  run.add_option(
         "--calibration", o.calibration,
         "Profile of this unit: auto uses the file that forcegrid calibrate wrote for it, none "
         "ignores that file, else a TOML file")
      ->show_default();
  run.add_flag(
      "--calibrated", o.calibrated,
      "The encoder counters are already valid: skip the calibration pose and its button (a "
      "Falcon is homed anyway)");
  run.add_option("--firmware", o.firmware,
                 "Firmware file for a Novint Falcon that runs none yet (always after power-on); an "
                 "emulated one gets a synthetic image by default");
  run.add_flag("--share", o.share,
               "Open the device although another program has it open, too. If that program sends "
               "anything, the run ends all the same");
  run.add_option("--device-timeout-ms", o.device_timeout_ms,
                 "The run ends with zero current when the device is silent for this long; the "
                 "device's own watchdog waits 500 ms")
      ->check(whole_between(10, 450))
      ->show_default()
      ->type_name("INT ms");
  run.add_flag("--reconnect", o.reconnect,
               "If the device disappears or falls silent, wait until it is back and continue");
  run.add_option("--reconnect-timeout", o.reconnect_timeout_s, "How long --reconnect waits")
      ->check(between(0.0, 86400.0))
      ->show_default()
      ->type_name("FLOAT s");
}

void add_object(Command& run, RunOptions& o) {
  run.begin_group("Object");
  run.add_option("--scene", o.scene, "Object to feel: " + scene_help())
      ->check(scene_check())
      ->show_default();
  run.add_option("--solver", o.solver,
                 "Solver of the started simulator, see 'forcegrid simulate --help'")
      ->check(one_of(simulator::solver_names()))
      ->show_default();
  run.add_option("--material-tolerance-percent", o.material_tolerance_percent,
                 "Option of the started simulator, see 'forcegrid simulate --help'")
      ->check(between(1e-4, 100.0))
      ->type_name("FLOAT %");
  add_tool(run, o.tool);
  run.add_option("--sim-rate", o.simulator_rate_Hz, "Answers per second of the started simulator")
      ->check(between(1.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT Hz");
  run.add_option("--sim-delay-ms", o.simulator_delay_ms,
                 "Delay every answer of the started simulator by this much")
      ->check(between(0.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT ms");
  run.add_option("--sim-jitter-ms", o.simulator_jitter_ms,
                 "Delay them further, each by a random time of up to this much")
      ->check(between(0.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT ms");
  run.add_option("--sim-loss-percent", o.simulator_loss_percent, "Lose this share of them")
      ->check(between(0.0, 100.0))
      ->show_default()
      ->type_name("FLOAT %");
  run.add_option("--workers", o.workers,
                 "Worker processes that answer requests for the started simulator; with workers, "
                 "--requests-per-s defaults to 120")
      ->check(whole_between(0, 64))
      ->show_default()
      ->type_name("INT processes");
  run.add_option("--simulator", o.simulator,
                 "ADDR:PORT of a simulator that already runs, instead of --scene; on another "
                 "machine only with --key");
  run.add_option("--tool-number", o.tool_number,
                 "Number of this run's tool at a --simulator that several servos share (simulate "
                 "--tools); several devices take it and the next ones (default 1 for those)")
      ->check(whole_between(1, 996))
      ->type_name("INT");
  add_key(run, o.key_files,
          "Encrypt the link to the simulator with this key file (forcegrid keygen)");
  run.add_option("--simulator-timeout", o.simulator_timeout_s,
                 "The run ends when the simulator has sent no sample for this long")
      ->check(between(1.0, 86400.0))
      ->show_default()
      ->type_name("FLOAT s");
  run.add_flag("--wait-for-simulator", o.wait_for_simulator,
               "Wait for a simulator that is silent, without an end, instead of ending the run");
}

void add_force(Command& run, RunOptions& o) {
  run.begin_group("Force");
  run.add_option("--method", o.method,
                 "Force method: " + joined(method_names()) +
                     ", direct; over the tools of two devices: " + joined(pair_method_names()) +
                     "; changes to its options may follow, e.g. \"forcegrid unit=m s=3\"")
      ->check(method_check())
      ->show_default();
  run.add_option(
         "--evaluate,--shadow", o.evaluated,
         "Methods that are evaluated beside it on the same path, but not rendered (--shadow is "
         "the deprecated spelling)")
      ->separated_by(';')
      ->check(method_check())
      ->show_default();
  run.add_option("--rate", o.rate_Hz, "Servo rate in Hz")
      ->check(between(100.0, 4000.0))
      ->show_default()
      ->type_name("FLOAT Hz");
  run.add_option(
         "--requests-per-s", o.requests_per_s,
         "How many forces per second the method may request from the simulator, at positions "
         "that the method chooses (default 120 for a method that needs them, else 0)")
      ->check(between(0.0, 4000.0))
      ->type_name("FLOAT 1/s");
  add_budget(run, o.budget);
  run.add_flag("--gravity-compensation", o.gravity_compensation,
               "Compensate the weight of the device's links");
}

void add_grid(Command& run, RunOptions& o) {
  run.begin_group("Grid methods");
  run.add_option("--fill-budget", o.fill_budget,
                 "Grid vertices that one method may update per cycle")
      ->check(whole_between(1, 1000000))
      ->show_default()
      ->type_name("INT vertices");
  run.add_option("--cells", o.cells, "Grid cells per axis: X,Y,Z")
      ->separated_by(',')
      ->check(whole_between(1, 4096))
      ->show_default()
      ->type_name("[INT,INT,INT] cells");
  run.add_option(
         "--r-mm", o.influence_radius_mm,
         "Radius of influence r of a sample; 0 means a sixth of the workspace's longest side")
      ->check(between(0.0, 1000.0))
      ->show_default()
      ->type_name("FLOAT mm");
  run.add_option("--unit-mm", o.unit_mm, "Unit of length in the grid's weight")
      ->check(between(0.001, 1000.0))
      ->show_default()
      ->type_name("FLOAT mm");
  run.add_option("--s", o.samples_per_cell, "Samples counted per cell, at most; 0 counts all")
      ->check(whole_between(0, 65535))
      ->show_default()
      ->type_name("INT samples");
}

void add_safety(Command& run, RunOptions& o) {
  run.begin_group("Safety");
  run.add_option("--passivity", o.passivity,
                 "What the guard does about energy that the force gives to the hand: control (damp "
                 "it), observe (only count it), coupling (render through a spring and damper)")
      ->check(one_of({"control", "observe", "coupling"}))
      ->show_default();
  run.add_option("--passivity-allowance-mJ", o.passivity_allowance_mJ,
                 "Energy per contact above which the control acts")
      ->check(between(0.01, 1000.0))
      ->type_name("FLOAT mJ")
      ->show_default();
  run.add_option("--passivity-damping", o.passivity_damping_N_s_per_m,
                 "Largest damping that the control may add; the profile's limit also applies")
      ->check(between(0.0, 100.0))
      ->type_name("FLOAT N s/m")
      ->show_default();
  run.add_option("--coupling", o.coupling, "Stiffness and damping K,B of --passivity coupling")
      ->separated_by(',')
      ->values(2)
      ->check(between(0.001, 1e6))
      ->type_name("FLOAT N/m and N s/m")
      ->show_default();
  run.add_option("--dead-man", o.dead_man,
                 "Render force only while this is held: button (any button on a Falcon's grip), "
                 "signal (SIGUSR2 at least every 0.2 s, for example from a foot switch), none")
      ->check(one_of({"none", "button", "signal"}))
      ->show_default();
  run.add_flag("--no-motor-check", o.no_motor_check,
               "Skip the check that pushes each motor briefly before the first force");
}

void add_hand(Command& run, RunOptions& o) {
  run.begin_group("Emulated device and hand");
  run.add_option("--hand", o.hand, "Emulated hand: " + joined(hands()))
      ->check(one_of(hands()))
      ->show_default();
  run.add_option("--motion", o.motion,
                 "Motion of the emulated hand: " + joined(motions()) +
                     "; a sliding tool uses stroke by default; of several devices one for all, or "
                     "one for each, separated by commas")
      ->check(motions_check())
      ->show_default();
  run.add_option("--wrist", o.wrist,
                 "How the emulated hand turns the wrist of a device that has one: " +
                     joined(wrist_motions()))
      ->check(one_of(wrist_motions()))
      ->show_default();
  run.add_option("--click-every", o.click_every_s,
                 "The emulated hand presses the button on the stylus this often; 0 means never")
      ->check(between(0.0, kMostClickEvery_s))
      ->show_default()
      ->type_name("FLOAT s");
  run.add_option("--amplitude-mm", o.amplitude_mm, "Amplitude of the motion")
      ->check(between(0.0, 30.0))
      ->show_default()
      ->type_name("FLOAT mm");
  run.add_option("--seed", o.seed, "Seed of the random motions")
      ->check(seed_number())
      ->show_default();
  run.add_option("--frame-order", o.frame_order, "Emulated bus: " + joined(frame_orders()))
      ->check(one_of(frame_orders()))
      ->show_default();
  run.add_option(
         "--core", o.core,
         "The emulated arm's motors are driven by a second processor in it; this is the Unix "
         "socket of its line (docs/firmware.md)")
      ->type_name("PATH")
      ->not_in_config();
  run.add_option("--fault", o.faults,
                 "Inject a fault into the emulated device, with N: before it into the Nth one "
                 "alone; may be "
                 "repeated, see forcegrid emulate --help")
      ->check(device_fault_check())
      ->repeatable();
}

void add_results(Command& run, RunOptions& o) {
  run.begin_group("Run and results");
  run.add_option("--seconds", o.seconds, "Length of the run; 0 runs until Ctrl-C")
      ->check(between(0.0, 86400.0))
      ->show_default()
      ->type_name("FLOAT s");
  run.add_flag(
      "--live", o.live,
      "Show a dashboard in the terminal (80 x 24 or larger) instead of one line per second");
  Option* const view = run.add_optional_value(
      "--view",
      [&o](const std::optional<std::string>& listen) {
        o.view = true;
        o.view_listen = listen.value_or(o.view_listen);
      },
      "Show the run in a browser, at this ADDR:PORT; without --view-key loopback only (default a "
      "free port)");
  view->not_in_config();
  run.add_option("--view-key", o.view_key,
                 "Serve the page of --view encrypted, with the private key and certificate of this "
                 "file")
      ->type_name("FILE.pem")
      ->not_in_config()
      ->needs(view);
  run.add_flag("--open", o.open_view, "Open the page of --view in the desktop's browser")
      ->not_in_config()
      ->needs(view);
  run.add_flag("--tour", o.tour,
               "Six steps in the page of --view that show what this is about; without an end")
      ->not_in_config()
      ->needs(view);
  run.add_option("--out", o.out, "Folder for the CSV, the picture and the flight record")
      ->show_default();
  run.add_flag("--no-reference,--no-truth", o.no_reference,
               "Skip the reference forces (--no-truth is the deprecated spelling)");
  run.add_option("--record", o.record,
                 "FILE.h5: record every cycle completely, as forcegrid record does. FILE.csv or "
                 ".csv.gz: record a trace for 'forcegrid evaluate': samples and, for each cycle, "
                 "position and reference force");
  run.add_flag("--record-surface", o.record_surface,
               "Record the object's surface, too, for 'forcegrid view': at most 4 MB/s")
      ->not_in_config();
  add_json(run, o.json);
}

Command& add_run_as(const char* name, const char* what, Command& app, RunOptions& o,
                    std::function<int()>& action) {
  Command& run = app.add_subcommand(name, what);
  add_device(run, o);
  add_object(run, o);
  add_force(run, o);
  add_grid(run, o);
  add_safety(run, o);
  add_hand(run, o);
  add_results(run, o);
  run.footer(run_status_help());
  run.callback([&run, &o, &action] {
    o.device = o.devices.front();
    o.motion_of_tool = o.motion == RunOptions().motion && !run.given("--motion");
    o.budget.on_command_line = run.given("--budget-us");
    for (const char* option : {"--scene", "--sim-delay-ms", "--sim-jitter-ms", "--sim-loss-percent",
                               "--material-tolerance-percent"}) {
      if (run.given(option)) {
        o.for_started_simulator.emplace_back(option);
      }
    }
    if (o.tour) {
      o.seconds = run.given("--seconds") ? o.seconds : 0.0;
      o.no_reference = true;
      o.scene = run.given("--scene") ? o.scene : kTourScene;
    }
    o.settings = run.settings_text();
    action = [&o] { return run_command(o); };
  });
  return run;
}

}  // namespace

void add_run(Command& app, RunOptions& o, std::function<int()>& action) {
  add_run_as("run", "Feel a scene through a device", app, o, action);
}

void add_record(Command& app, RunOptions& o, std::function<int()>& action) {
  Command& record =
      add_run_as("record", "Feel a scene and record every cycle to HDF5, see docs/recording.md",
                 app, o, action);
  record.remove_option("--record");
  record.add_option("FILE", o.record, "Recording to write, FILE.h5")
      ->required()
      ->check(Check{[](const std::string& input) {
                      return tools::is_recording_name(input)
                                 ? std::string()
                                 : "'" + input +
                                       "' does not end in .h5 or .hdf5, as a recording's name does";
                    },
                    "FILE.h5"});
}

}  // namespace forcegrid::cli
