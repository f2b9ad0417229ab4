// SPDX-License-Identifier: Apache-2.0
#include "cli/device/calibrate_command.h"

#include <poll.h>
#include <unistd.h>

#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>
#include <optional>

#include "calibration/device_rig.h"
#include "calibration/joint_names.h"
#include "calibration/procedure.h"
#include "cli/common/child_process.h"
#include "cli/common/firmware_choice.h"
#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/revision.h"
#include "cli/common/stop_request.h"
#include "cli/common/stop_watchdog.h"
#include "cli/common/tools_names.h"
#include "cli/run/run_setup.h"
#include "device_emulator/run_emulator.h"
#include "driver/calibration.h"
#include "driver/device_url.h"
#include "driver/open_device.h"
#include "log/log.h"
#include "rt/thread.h"
#include "tools/unit_profile.h"

namespace forcegrid::cli {
namespace {

using calibration::Check;
using calibration::ProcedureOptions;
using calibration::ProcedureResult;
using nlohmann::ordered_json;

constexpr auto kHomingTimeout = std::chrono::seconds(120);

std::string today() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  char text[32];
  if (gmtime_r(&now, &parts) == nullptr ||
      std::strftime(text, sizeof text, "%Y-%m-%d", &parts) == 0) {
    return "an unknown day";
  }
  return text;
}

// Whether standard input has a newline or has ended; does not wait.
bool enter_pressed() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  if (::poll(&input, 1, 0) <= 0) {
    return false;
  }
  char typed = 0;
  return ::read(STDIN_FILENO, &typed, 1) <= 0 || typed == '\n';
}

std::unique_ptr<ChildProcess> start_emulator(const CalibrateOptions& options,
                                             const std::string& profile) {
  std::vector<std::string> arguments = {"emulate",
                                        "--device",
                                        profile,
                                        "--listen",
                                        "127.0.0.1:0",
                                        "--tip-mass",
                                        std::to_string(options.tip_mass_kg),
                                        "--hand",
                                        options.calibrated ? "none" : "firm",
                                        "--until-stdin-closes"};
  if (options.calibrated) {
    arguments.emplace_back("--calibrated");
  } else {
    arguments.insert(arguments.end(), {"--let-go", "--random-counters"});
  }
  return std::make_unique<ChildProcess>(arguments, ChildOptions{.name = "emulator"});
}

ordered_json json_of(const calibration::Estimate& estimate) {
  return {{"value", estimate.value}, {"standard_error", estimate.error}};
}

ordered_json json_of(const profiles::DeviceProfile& profile, const ProcedureResult& result) {
  ordered_json joints = ordered_json::array();
  for (int index = 0; index < 3; ++index) {
    const calibration::JointResult& joint = result.joints[static_cast<std::size_t>(index)];
    ordered_json one = {{"joint", calibration::joint_name(profile, index)}};
    if (joint.range) {
      one["range"] = {{"low_rad", joint.range->low_rad},
                      {"high_rad", joint.range->high_rad},
                      {"offset_counts", joint.range->offset_counts},
                      {"offset_standard_error_counts", joint.range->offset_error_counts}};
    }
    if (joint.fit) {
      one["coulomb_friction_Nm"] = joint.coulomb_Nm;
      one["viscous_friction_Nm_s_per_rad"] = joint.viscous_Nm_s_per_rad;
      one["fit"] = {{"scale", json_of(joint.fit->scale)},
                    {"coulomb_Nm", json_of(joint.fit->coulomb_Nm)},
                    {"viscous_Nm_s_per_rad", json_of(joint.fit->viscous_Nm_s_per_rad)},
                    {"delay_s", json_of(joint.fit->delay_s)},
                    {"residual_rms_Nm", joint.fit->residual_Nm},
                    {"samples", joint.fit->samples}};
    }
    if (joint.torque_constant_Nm_per_A) {
      one["torque_constant_Nm_per_A"] = *joint.torque_constant_Nm_per_A;
    }
    joints.push_back(std::move(one));
  }
  ordered_json checks = ordered_json::array();
  for (const Check& check : result.checks) {
    checks.push_back({{"check", check.name}, {"passed", check.passed}, {"what", check.text}});
  }
  ordered_json changes = ordered_json::object();
  for (const auto& [key, value] : result.changes) {
    changes[key] = ordered_json::parse(value);
  }
  ordered_json json = {{"passed", result.passed()},
                       {"absolute", result.absolute},
                       {"checks", checks},
                       {"joints", joints},
                       {"changes", changes},
                       {"largest_tip_speed_m_per_s", result.largest_tip_speed_m_per_s},
                       {"largest_current_A", result.largest_current_A}};
  if (result.knob_travel) {
    json["knob_travel"] = {{"in_m", result.knob_travel->in_m},
                           {"out_m", result.knob_travel->out_m}};
  }
  if (result.torque_gain_per_Nm) {
    json["torque_gain_per_Nm"] = *result.torque_gain_per_Nm;
  }
  return json;
}

class Calibration {
 public:
  explicit Calibration(const CalibrateOptions& options) : options_(options) {}

  int run() {
    check_options();
    open();
    if (!home()) {
      throw calibration::Stopped();
    }
    const ProcedureResult result = procedure();
    zero_delivered_ = device_->stop();
    for (const Check& check : result.checks) {
      report(std::string(check.passed ? "ok      " : "FAILED  ") + check.name + ": " + check.text);
    }
    if (result.passed() && !result.absolute && !options_.no_strokes) {
      report(
          "Without a known mass (--tip-mass) only the ratio of friction to torque constant can be "
          "measured: the profile keeps its torque constants and gets the friction that fits them.");
    }
    ordered_json json = {{"device", device_->identity().url},
                         {"product", device_->identity().product},
                         {"serial", device_->identity().serial},
                         {"profile", profile_.name},
                         {"unit", key_},
                         {"zero_current_delivered", zero_delivered_}};
    json.update(json_of(profile_, result));
    const std::string file = write(result);
    json["written"] = file.empty() ? ordered_json() : ordered_json(file);
    write_json(options_.json, json.dump(2));
    return result.passed() ? 0 : kCheckFailedStatus;
  }

 private:
  void say(const std::string& line) const { say_step(options_.json, "calibration", line); }
  void report(const std::string& line) const { say_result(options_.json, "calibration", line); }

  // The emulated hand of a device that this program starts needs no questions.
  bool somebody_is_there() const {
    return !options_.yes && !options_.device.starts_with(kEmulatedPrefix);
  }

  void check_options() const {
    if (somebody_is_there() && ::isatty(STDIN_FILENO) == 0) {
      throw std::runtime_error(
          "calibrate asks a person to let go of the device, but standard input is no terminal; "
          "in a script give --yes, and make sure that nobody touches the device");
    }
    if (somebody_is_there() && !log::console_shows(log::Level::kInfo)) {
      throw std::runtime_error(
          "calibrate tells a person what to do, which --quiet or --log-level hides; leave it out, "
          "or give --yes and make sure that nobody touches the device");
    }
    if (options_.no_range && options_.no_strokes) {
      say("--no-range and --no-strokes leave homing and directions.");
    }
    check_writable(options_.json);
  }

  void open() {
    const bool emulated = options_.device.starts_with(kEmulatedPrefix);
    // An emulated device may be given another profile, to show what the checks find.
    const std::string own_profile = profile_name_of(options_.device, "");
    profile_ =
        profiles::load_device_profile(options_.profile.empty() ? own_profile : options_.profile);
    const std::string realtime_refused =
        rt::make_current_thread_realtime(rt::kServoPriority).reason;
    if (!realtime_refused.empty()) {
      say("No real-time scheduling: " + realtime_refused);
    }
    std::string url = options_.device;
    std::string lasting = "emulated";
    driver::OpenOptions open_options;
    open_options.firmware = firmware_for(options_.firmware, profile_, emulated);
    open_options.realtime_io = realtime_refused.empty();
    open_options.share = options_.share;
    open_options.notice = [](const std::string& text) { log::info("device", text); };
    open_options.stale_after = std::chrono::milliseconds(options_.device_timeout_ms);
    if (emulated) {
      emulator_ = start_emulator(options_, own_profile);
      url = "usbip://" + listening_address(*emulator_) + "/1-1";
    }
    device_ = driver::open_device(url, profile_, open_options);
    own_end_.emplace();  // until here no current was ever commanded
    if (!emulated) {
      lasting = driver::lasting_url(url, profile_);
    }
    key_ = tools::unit_key(device_->identity(), lasting);
    say("Device: " + device_->identity().product + ", serial " + device_->identity().serial +
        ", at " + url + "; profile " + profile_.name + ", unit " + key_);
  }

  bool home() {
    if (options_.tip_mass_kg > 0.0) {
      char text[120];
      std::snprintf(text, sizeof text, "Fasten the mass of %.3f kg to the tip now.",
                    options_.tip_mass_kg);
      say(text);
    }
    const bool delta = profile_.kind == profiles::DeviceKind::kDelta;
    if (options_.calibrated && !delta) {
      return true;
    }
    return driver::calibrate(
        *device_, profile_, kHomingTimeout, [&](const std::string& text) { say(text); },
        [] { return StopRequest::stop().load(); });
  }

  ProcedureResult procedure() {
    ProcedureOptions procedure;
    procedure.known_mass_kg = options_.tip_mass_kg;
    procedure.homed = !options_.calibrated;
    procedure.range = !options_.no_range;
    procedure.identify = !options_.no_strokes;
    procedure.quick = options_.quick;
    procedure.let_go_s = options_.let_go_s;
    ProgressLine progress;
    procedure.say = [&](const std::string& line, std::optional<double> length_s) {
      progress.clear();
      say(line);
      const std::string what = line.substr(0, line.find_last_not_of('.') + 1);
      length_s ? progress.begin(what, *length_s) : progress.begin(what);
    };
    if (somebody_is_there()) {
      procedure.person_done = enter_pressed;
    }
    calibration::DeviceRig rig(*device_, rt::from_seconds(1.0 / options_.rate_Hz),
                               std::chrono::milliseconds(options_.device_timeout_ms),
                               StopRequest::stop());
    return calibration::run_procedure(rig, profile_, procedure);
  }

  // Returns the file that was written; empty: none.
  std::string write(const ProcedureResult& result) const {
    if (result.changes.empty()) {
      report(result.passed() ? "There is nothing to write."
                             : "Nothing is written because a check failed.");
      return "";
    }
    for (const auto& [key, value] : result.changes) {
      report("  " + key + " = " + value);
    }
    if (options_.dry_run) {
      report("Nothing is written (--dry-run).");
      return "";
    }
    const std::string file =
        options_.write.empty() ? tools::unit_profile_file(profile_.name, key_) : options_.write;
    tools::write_unit_profile(
        file, profile_.file,
        "Calibrated " + today() + " by forcegrid " + program_version() + " from " + profile_.name +
            ": " + device_->identity().product + ", unit " + key_ +
            (result.absolute ? "" : "; torque constants not measured without a known mass"),
        result.changes);
    report("Written to " + file +
           (options_.write.empty() ? "; 'forcegrid run' uses it for this unit."
                                   : "; use it with --profile."));
    return file;
  }

  const CalibrateOptions& options_;
  std::unique_ptr<ChildProcess> emulator_;
  profiles::DeviceProfile profile_;
  std::optional<OwnEnd> own_end_;  // from when motors may get current until the device is closed
  std::unique_ptr<driver::Device> device_;
  std::string key_;
  bool zero_delivered_ = false;
};

}  // namespace

void add_calibrate(Command& app, CalibrateOptions& o, std::function<int()>& action) {
  Command& calibrate = app.add_subcommand("calibrate", tools_description("calibrate"));
  calibrate
      .add_option(
          "--device", o.device,
          "emulated:PROFILE, or an attached device:\n" + std::string(driver::device_url_forms()))
      ->show_default();
  calibrate.add_option(
      "--profile", o.profile,
      "Profile that the device is assumed to have (default: the emulated one, falcon for a "
      "Falcon, else woodenhaptics_v2015)");
  calibrate.add_option("--firmware", o.firmware,
                       "Firmware file for a Novint Falcon that runs none yet");
  calibrate
      .add_option("--tip-mass", o.tip_mass_kg,
                  "Known mass, 0.05 or 0.1 kg, that you have fastened to the tip; needed to "
                  "measure the torque constants")
      ->check(between(0.0, emulator::kMaxTipMass_kg))
      ->type_name("FLOAT kg")
      ->show_default()
      ->not_in_config();
  calibrate
      .add_flag("--calibrated", o.calibrated,
                "The encoder counters are already valid: no pose, no button")
      ->not_in_config();
  calibrate.add_flag("--no-range", o.no_range, "Do not move to the hard stops");
  calibrate.add_flag("--no-strokes", o.no_strokes, "Do not measure friction and torque constants");
  calibrate.add_flag("--quick", o.quick, "Fewer strokes: half the time, twice the uncertainty");
  calibrate
      .add_flag("--yes", o.yes,
                "Ask nothing, for scripts: nobody may touch the device after --let-go-s")
      ->not_in_config();
  calibrate
      .add_option("--let-go-s", o.let_go_s,
                  "With --yes: how long the motors hold the device until "
                  "nobody holds it any more")
      ->check(between(0.0, 600.0))
      ->type_name("FLOAT s")
      ->show_default();
  calibrate.add_option("--rate", o.rate_Hz, "Control steps per second")
      ->check(between(250.0, 2000.0))
      ->type_name("FLOAT Hz")
      ->show_default();
  calibrate.add_flag("--share", o.share,
                     "Open the device although another program has it open, too. If that program "
                     "sends anything, the calibration ends all the same");
  calibrate
      .add_option("--device-timeout-ms", o.device_timeout_ms,
                  "The calibration ends with zero current when the device is silent for this long; "
                  "the device's own watchdog waits 500 ms")
      ->check(whole_between(10, 450))
      ->type_name("INT ms")
      ->show_default();
  calibrate
      .add_option("--write", o.write,
                  "FILE.toml to write the profile to, instead of the place where run finds it")
      ->not_in_config();
  calibrate.add_flag("--dry-run", o.dry_run, "Measure and report, but write nothing")
      ->not_in_config();
  calibrate.footer(
      "Currents stay below half of the profile's limits, the tip below 0.6 of its largest speed.\n"
      "Exit status: 0 all is well, 1 the device can't be used, 2 words that can't be "
      "understood, 3 a check failed and nothing was written, 130 or 143 after SIGINT or SIGTERM. "
      "See docs/calibrate.md.");
  calibrate.callback([&o, &action] { action = [&o] { return calibrate_command(o); }; });
}

int calibrate_command(const CalibrateOptions& options) { return Calibration(options).run(); }

}  // namespace forcegrid::cli
