// SPDX-License-Identifier: Apache-2.0
#include "cli/device/doctor_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>

#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/revision.h"
#include "cli/common/stop_request.h"
#include "cli/common/stop_watchdog.h"
#include "driver/open_device.h"
#include "link/address.h"
#include "tools/atomic_file.h"
#include "tools/doctor.h"
#include "tools/doctor_report.h"
#include "tools/doctor_timing.h"
#include "tools/library_versions.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::Finding;
using tools::Verdict;

constexpr int kWarnings = 3;
constexpr int kBad = 4;

// The program's own version first, then those of its libraries.
std::vector<tools::PartVersion> versions() {
  std::vector<tools::PartVersion> parts = {{"forcegrid", program_version(), false},
                                           {"commit", program_commit(), false}};
  for (tools::PartVersion& part : tools::library_versions()) {
    parts.push_back(std::move(part));
  }
  parts.push_back({"CLI11", options_library_version(), false});
  return parts;
}

Finding versions_finding(const std::vector<tools::PartVersion>& parts) {
  std::string loaded;
  std::string compiled_in;
  for (const tools::PartVersion& part : parts) {
    std::string& text = part.loaded ? loaded : compiled_in;
    text += (text.empty() ? "" : ", ") + part.name + " " + part.version;
  }
  return {.check = "versions", .what = compiled_in + "; loaded: " + loaded};
}

constexpr char kDeviceCheck[] = "USB round trip";
constexpr char kSimulatorCheck[] = "simulator's round trip";

// A measurement that fails becomes a finding, so that the other findings are still printed.
Finding device_finding(const DoctorOptions& options, const profiles::DeviceProfile& profile) {
  try {
    driver::OpenOptions open_options;
    open_options.share = options.share;
    const auto device = driver::open_device(options.device, profile, open_options);
    const OwnEnd own_end;
    const tools::RoundTrips trips =
        tools::measure_device_round_trip(*device, options.seconds, StopRequest::stop());
    static_cast<void>(device->stop());  // no current was ever commanded
    return tools::judge_round_trips(kDeviceCheck, trips,
                                    "plug the device in again and run 'forcegrid devices'");
  } catch (const driver::DeviceError& error) {
    return tools::not_measured(kDeviceCheck, error.what());
  }
}

Finding simulator_finding(const DoctorOptions& options) {
  try {
    return tools::judge_round_trips(
        kSimulatorCheck,
        tools::measure_simulator_round_trip(options.simulator, options.seconds,
                                            StopRequest::stop()),
        "start the simulator: forcegrid simulate --listen " + options.simulator);
  } catch (const link::LinkError& error) {
    return tools::not_measured(kSimulatorCheck, error.what());
  }
}

// @param profile of the device to measure with; none: no device
std::vector<Finding> measure(const DoctorOptions& options,
                             const std::optional<profiles::DeviceProfile>& profile,
                             std::FILE* out) {
  const auto& stop = StopRequest::stop();
  std::vector<Finding> findings;
  // A measurement that was cut short says nothing.
  const auto keep = [&](Finding finding) {
    findings.push_back(
        stop ? Finding{.check = finding.check,
                       .verdict = Verdict::kUnknown,
                       .what = "not measured: stopped by " + StopRequest::signal_name()}
             : std::move(finding));
  };
  const double period_s = 1.0 / options.rate_Hz;
  ProgressLine line;
  const auto begin = [&](const std::string& what) {
    line.clear();
    std::fprintf(out, "%s, %.0f s ...\n", what.c_str(), options.seconds);
    std::fflush(out);
    line.begin(what, options.seconds);
  };
  for (const bool load : {false, true}) {
    const std::string check = load ? "wake-up under load" : "wake-up idle";
    if (stop) {
      keep({.check = check});
      continue;
    }
    begin(std::string("measuring wake-ups ") + (load ? "under load" : "idle"));
    const tools::WakeupTest test = tools::measure_wakeups(options.seconds, period_s, load, stop);
    keep(tools::judge_wakeups(check, test, 1e6 * period_s));
  }
  if (profile && stop) {
    keep({.check = kDeviceCheck});
  } else if (profile) {
    begin("measuring the round trip with " + options.device);
    keep(device_finding(options, *profile));
  }
  if (!options.simulator.empty() && stop) {
    keep({.check = kSimulatorCheck});
  } else if (!options.simulator.empty()) {
    begin("measuring the round trip with " + options.simulator);
    keep(simulator_finding(options));
  }
  return findings;
}

void print(std::FILE* out, const Finding& finding) {
  std::fprintf(out, "%-8s %s: %s\n", to_string(finding.verdict), finding.check.c_str(),
               finding.what.c_str());
  if (!finding.cost.empty()) {
    std::fprintf(out, "         costs: %s\n", finding.cost.c_str());
  }
  if (!finding.remedy.empty()) {
    std::fprintf(out, "         fix: %s\n", finding.remedy.c_str());
  }
  for (const std::string& line : tools::histogram_lines(finding.histogram)) {
    std::fprintf(out, "         %s\n", line.c_str());
  }
}

ordered_json json_of(const Finding& finding) {
  ordered_json measured = ordered_json::object();
  for (const auto& [name, value] : finding.measured) {
    measured[name] = value;
  }
  ordered_json histogram = ordered_json::array();
  for (const tools::LatencyBin& bin : finding.histogram) {
    const bool bounded = std::isfinite(bin.up_to_us);
    histogram.push_back({{"up_to_us", bounded ? ordered_json(bin.up_to_us) : ordered_json()},
                         {"count", bin.count}});
  }
  return {{"check", finding.check},   {"verdict", to_string(finding.verdict)},
          {"what", finding.what},     {"cost", finding.cost},
          {"remedy", finding.remedy}, {"fixable", !finding.fixes.empty()},
          {"measured", measured},     {"histogram", histogram}};
}

tools::DoctorSystem system_below(const std::string& root) {
  tools::DoctorSystem system;
  for (std::string* path :
       {&system.roots.sysfs, &system.roots.dev, &system.roots.proc, &system.etc}) {
    *path = root + *path;
  }
  for (std::string& folder : system.roots.rule_folders) {
    folder = root + folder;
  }
  system.user = tools::current_user();
  system.grants = tools::ask_kernel();
  return system;
}

void write_report(const DoctorOptions& options, const std::vector<profiles::DeviceProfile>& known,
                  const std::vector<tools::PartVersion>& parts,
                  const std::vector<Finding>& findings, std::FILE* out) {
  if (StopRequest::stop()) {
    std::fprintf(out, "%s was not written, because the measurements were interrupted\n",
                 options.report.c_str());
    return;
  }
  const tools::DoctorSystem system = system_below(options.root);
  const tools::ReportContent content{parts, findings,
                                     tools::survey_devices(known, system.roots, system.user)};
  const tools::PrivateWords words = tools::private_words(system, options.root, content.devices);
  tools::replace_file(options.report, tools::doctor_report(content, system.roots, words), nullptr);
  std::fprintf(out,
               "Wrote %s. Read it, complete its blanks (docs/bring_up.md), and attach it to an "
               "issue in the project's tracker\n",
               options.report.c_str());
}

// Each file once: several findings may need the same fix.
std::vector<std::string> fix_all(const std::vector<Finding>& findings) {
  std::vector<tools::FileFix> fixes;
  std::set<std::string> files;
  for (const Finding& finding : findings) {
    for (const tools::FileFix& fix : finding.fixes) {
      if (files.insert(fix.file).second) {
        fixes.push_back(fix);
      }
    }
  }
  return tools::apply_fixes(fixes);
}

}  // namespace

void add_doctor(Command& app, DoctorOptions& o, std::function<int()>& action) {
  Command& doctor = app.add_subcommand(
      "doctor", "Check this computer: what is wrong, what it costs, and the command that fixes it");
  doctor.add_option("--seconds", o.seconds, "Length of each measurement; 0 skips them")
      ->check(between(0.0, 3600.0))
      ->type_name("FLOAT s")
      ->show_default();
  doctor.add_option("--rate", o.rate_Hz, "Servo rate for which wake-ups are measured and judged")
      ->check(between(100.0, 4000.0))
      ->type_name("FLOAT Hz")
      ->show_default();
  doctor.add_option("--device", o.device, "Device to measure the USB round trip with, as in run");
  doctor.add_flag("--share", o.share, "Measure although another program has the device open, too");
  doctor.add_option("--profile", o.profile, "Its profile")->show_default();
  doctor.add_option("--simulator", o.simulator, "ADDR:PORT of a simulator to measure UDP with");
  doctor
      .add_flag("--fix", o.fix,
                "Do what can be done without risk, and say what was done: rule, limits, governor, "
                "autosuspend")
      ->not_in_config();
  doctor
      .add_option("--report", o.report,
                  "Write a form in Markdown that you can complete and send to the project; it has "
                  "no serial numbers, user or host names")
      ->type_name("FILE")
      ->not_in_config();
  doctor
      .add_option("--root", o.root,
                  "Folder before /sys, /dev, /proc and /etc, e.g. of another system's image")
      ->not_in_config();
  doctor.footer(
      "Exit status: 0 nothing is wrong, 3 warnings only, 4 something is bad, 130 or 143 after "
      "SIGINT or SIGTERM.");
  doctor.callback([&o, &action] { action = [&o] { return doctor_command(o); }; });
}

int doctor_command(const DoctorOptions& options) {
  const ResultText text(options.json, "doctor");
  std::FILE* const out = text.stream();
  if (const std::string why_not = options.report.empty() ? "" : why_not_writable(options.report);
      !why_not.empty()) {
    throw std::runtime_error("--report " + options.report + " can't be written (" + why_not +
                             "); name a file in a folder that exists");
  }
  std::optional<profiles::DeviceProfile> profile;  // so that a wrong name is reported at once
  if (!options.device.empty()) {
    profile = profiles::load_device_profile(options.profile);
  }
  std::vector<profiles::DeviceProfile> known;
  for (const std::string& name : profiles::available_profiles()) {
    known.push_back(profiles::load_device_profile(name));
  }
  std::vector<Finding> findings = tools::examine_system(system_below(options.root), known);
  std::vector<std::string> done;
  if (options.fix) {
    done = fix_all(findings);
    findings = tools::examine_system(system_below(options.root), known);
  }
  const std::vector<tools::PartVersion> parts = versions();
  findings.push_back(versions_finding(parts));
  if (options.seconds > 0.0) {
    for (Finding& finding : measure(options, profile, out)) {
      findings.push_back(std::move(finding));
    }
  }
  ordered_json list = ordered_json::array();
  for (const Finding& finding : findings) {
    print(out, finding);
    list.push_back(json_of(finding));
  }
  for (const std::string& sentence : done) {
    std::fprintf(out, "fixed:   %s\n", sentence.c_str());
  }
  if (options.fix && done.empty()) {
    std::fprintf(out, "fixed: nothing; no finding has a fix without risk\n");
  }
  if (!options.report.empty()) {
    write_report(options, known, parts, findings, out);
  }
  ordered_json version_of = ordered_json::object();
  for (const tools::PartVersion& part : parts) {
    version_of[part.name] = part.version;
  }
  write_json(options.json,
             ordered_json{{"findings", list}, {"fixed", done}, {"versions", version_of}}.dump(2));
  const auto any = [&](Verdict verdict) {
    return std::any_of(findings.begin(), findings.end(),
                       [&](const Finding& finding) { return finding.verdict == verdict; });
  };
  return any(Verdict::kBad) ? kBad : any(Verdict::kWarn) ? kWarnings : 0;
}

}  // namespace forcegrid::cli
