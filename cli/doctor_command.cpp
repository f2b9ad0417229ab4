#include "cli/doctor_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>

#include "cli/stop_request.h"
#include "driver/open_device.h"
#include "tools/doctor.h"
#include "tools/doctor_timing.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::Finding;
using tools::Verdict;

constexpr int kWarnings = 3;
constexpr int kBad = 4;

// Round trips have no deadline of their own: what they cost is told, not judged.
Finding round_trip(const std::string& check, const rt::Percentiles& us,
                   const std::string& nothing) {
  Finding finding{.check = check};
  finding.measured = {{"round_trips", static_cast<double>(us.count())},
                      {"p50_us", us.at(0.5)},
                      {"p99_us", us.at(0.99)},
                      {"p99_9_us", us.at(0.999)},
                      {"max_us", us.max()}};
  char text[160];
  std::snprintf(text, sizeof text, "%.0f us in the median, p99 %.0f, p99.9 %.0f, worst %.0f",
                us.at(0.5), us.at(0.99), us.at(0.999), us.max());
  finding.what = text;
  if (us.count() == 0) {
    finding.verdict = Verdict::kBad;
    finding.what = "no answer at all";
    finding.cost = "nothing can be felt";
    finding.remedy = nothing;
  }
  return finding;
}

std::vector<Finding> measure(const DoctorOptions& options, std::FILE* out) {
  const auto& stop = StopRequest::stop();
  std::vector<Finding> findings;
  const double period_s = 1.0 / options.rate_Hz;
  for (const bool load : {false, true}) {
    std::fprintf(out, "measuring wake-ups %s, %.0f s ...\n", load ? "under load" : "idle",
                 options.seconds);
    const tools::WakeupTest test = tools::measure_wakeups(options.seconds, period_s, load, stop);
    findings.push_back(tools::judge_wakeups(load ? "wake-up under load" : "wake-up idle",
                                            test.latency_us, 1e6 * period_s, test.realtime));
  }
  if (!options.device.empty()) {
    std::fprintf(out, "measuring the round trip with %s, %.0f s ...\n", options.device.c_str(),
                 options.seconds);
    const auto device =
        driver::open_device(options.device, profiles::load_device_profile(options.profile));
    const rt::Percentiles us = tools::measure_device_round_trip(*device, options.seconds, stop);
    static_cast<void>(device->stop());  // no current was ever asked for
    findings.push_back(
        round_trip("USB round trip", us, "plug the device in again and look at forcegrid devices"));
  }
  if (!options.simulator.empty()) {
    std::fprintf(out, "measuring the round trip with %s, %.0f s ...\n", options.simulator.c_str(),
                 options.seconds);
    findings.push_back(
        round_trip("simulator's round trip",
                   tools::measure_simulator_round_trip(options.simulator, options.seconds, stop),
                   "start the simulator: forcegrid simulate --listen " + options.simulator));
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
    std::fprintf(out, "         mend:  %s\n", finding.remedy.c_str());
  }
}

ordered_json json_of(const Finding& finding) {
  ordered_json measured = ordered_json::object();
  for (const auto& [name, value] : finding.measured) {
    measured[name] = value;
  }
  return {{"check", finding.check},   {"verdict", to_string(finding.verdict)},
          {"what", finding.what},     {"cost", finding.cost},
          {"remedy", finding.remedy}, {"fixable", !finding.fixes.empty()},
          {"measured", measured}};
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

// Each file once: several findings may want the same.
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

void add_doctor(CLI::App& app, DoctorOptions& o, std::function<int()>& action) {
  CLI::App& doctor = *app.add_subcommand(
      "doctor",
      "Examine this computer: what is wrong, what it costs, and the command that mends it");
  doctor.add_option("--seconds", o.seconds, "Length of each measurement; 0 leaves them out")
      ->check(CLI::Range(0.0, 3600.0))
      ->type_name("FLOAT s")
      ->capture_default_str();
  doctor.add_option("--rate", o.rate_Hz, "Servo rate that wake-ups are measured and judged for")
      ->check(CLI::Range(100.0, 4000.0))
      ->type_name("FLOAT Hz")
      ->capture_default_str();
  doctor.add_option("--device", o.device, "Device to measure the USB round trip with, as of run");
  doctor.add_option("--profile", o.profile, "Its profile")->capture_default_str();
  doctor.add_option("--simulator", o.simulator, "ADDR:PORT of a simulator to measure UDP with");
  doctor
      .add_flag("--fix", o.fix,
                "Do what can be done without risk, and say what was done: rule, limits, governor, "
                "autosuspend")
      ->configurable(false);
  doctor
      .add_option("--root", o.root,
                  "Folder before /sys, /dev, /proc and /etc, e.g. of another system's image")
      ->configurable(false);
  doctor.footer("Exit status: 0 nothing is wrong, 3 warnings only, 4 something is bad.");
  doctor.callback([&o, &action] { action = [&o] { return doctor_command(o); }; });
}

int doctor_command(const DoctorOptions& options) {
  std::FILE* const out = options.json.on_stdout() ? stderr : stdout;
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
  findings.push_back(tools::library_versions());
  if (options.seconds > 0.0) {
    for (Finding& finding : measure(options, out)) {
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
    std::fprintf(out, "fixed:   nothing; there is nothing that can be mended without risk\n");
  }
  write_json(options.json, ordered_json{{"findings", list}, {"fixed", done}}.dump(2));
  const auto any = [&](Verdict verdict) {
    return std::any_of(findings.begin(), findings.end(),
                       [&](const Finding& finding) { return finding.verdict == verdict; });
  };
  return any(Verdict::kBad) ? kBad : any(Verdict::kWarn) ? kWarnings : 0;
}

}  // namespace forcegrid::cli
