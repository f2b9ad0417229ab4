#include "cli/tune_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <thread>

#include "cli/child_process.h"
#include "cli/scene_option.h"
#include "cli/stop_request.h"
#include "profiles/device_profile.h"
#include "tools/config_file.h"
#include "tools/tuning.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::TuningRow;

constexpr int kNoneMeets = 3;
constexpr double kShortestRun_s = 6.0;  // 2 s until the touch, 1 s of learning, the rest is judged
constexpr double kOverhead_s = 4.0;     // starting, calibrating, off-line forces
constexpr std::chrono::seconds kPatience{120};
constexpr char kEmulated[] = "emulated:";

std::string profile_of(const TuneOptions& options) {
  if (options.device.starts_with(kEmulated)) {
    return options.device.substr(sizeof kEmulated - 1);
  }
  return options.profile.empty() ? "woodenhaptics_v2015" : options.profile;
}

// The device sets the fastest pace: one report a bus frame.
void check_rates(const TuneOptions& options) {
  const profiles::DeviceProfile profile = profiles::load_device_profile(profile_of(options));
  const double pace_Hz = 1e6 / profile.usb.frame_period_us;
  for (const double rate_Hz : options.rates_Hz) {
    if (rate_Hz > pace_Hz) {
      char text[300];
      std::snprintf(text, sizeof text,
                    "--rates %.0f: %s answers once a bus frame of %d us, %.0f times a second at "
                    "most; 2 and 4 kHz need a high-speed device, or simulated time (forcegrid "
                    "chart stability)",
                    rate_Hz, profile.name.c_str(), profile.usb.frame_period_us, pace_Hz);
      throw std::runtime_error(text);
    }
  }
}

// A method without a grid fills nothing, so that one budget tells all.
std::vector<TuningRow> rows_to_measure(const TuneOptions& options) {
  std::vector<TuningRow> rows;
  for (const std::string& method : options.methods) {
    for (const double rate_Hz : options.rates_Hz) {
      for (const int budget : options.fill_budgets) {
        TuningRow row;
        row.rate_Hz = rate_Hz;
        row.fill_budget = budget;
        row.method = method;
        rows.push_back(row);
        if (!method.starts_with("forcegrid")) {
          break;
        }
      }
    }
  }
  return rows;
}

double percentile(const ordered_json& summary, const char* key, const char* which) {
  return summary.at(key).at(which).get<double>();
}

void take(const ordered_json& summary, TuningRow& row) {
  if (!summary.at("faults").empty()) {
    row.problem = summary.at("faults").front().at("sentence").get<std::string>();
    return;
  }
  const ordered_json& errors = summary.at("errors");
  if (errors.empty()) {
    row.problem = "no error is known: " + summary.at("truth").get<std::string>();
    return;
  }
  row.error_percent = errors.front().at("rms_error_percent_after_1s").get<double>();
  const double missed = summary.at("missed_deadlines").get<double>();
  row.missed_percent = 100.0 * missed / (missed + summary.at("cycles").get<double>());
  row.period_p99_us = percentile(summary, "period_us", "p99");
  row.compute_p50_us = percentile(summary, "compute_us", "p50");
  row.compute_p99_us = percentile(summary, "compute_us", "p99");
  const double samples = summary.at("samples_taken").get<double>();
  const double cut = summary.at("counters").value("fills_cut_short", 0.0);
  row.backlog_percent = samples > 0.0 ? 100.0 * cut / samples : 0.0;
}

void measure(const TuneOptions& options, double seconds, TuningRow& row) {
  const std::string folder = options.out + "/tuning_run";
  const std::string file = folder + "/summary.json";
  std::filesystem::create_directories(folder);
  std::filesystem::remove(file);
  std::vector<std::string> arguments{"run",
                                     "--device",
                                     options.device,
                                     "--scene",
                                     options.scene,
                                     "--motion",
                                     options.motion,
                                     "--method",
                                     row.method,
                                     "--shadow",
                                     row.method,
                                     "--rate",
                                     std::to_string(row.rate_Hz),
                                     "--fill-budget",
                                     std::to_string(row.fill_budget),
                                     "--seconds",
                                     std::to_string(seconds),
                                     "--out",
                                     folder,
                                     "--json",
                                     file};
  if (!options.profile.empty()) {
    arguments.insert(arguments.end(), {"--profile", options.profile});
  }
  ChildProcess run(arguments);
  const auto deadline = std::chrono::steady_clock::now() +
                        std::chrono::milliseconds(std::lround(1e3 * seconds)) + kPatience;
  while (run.running() && !StopRequest::stop() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  if (run.running()) {
    row.problem = StopRequest::stop() ? "stopped" : "the run did not end";
    return;
  }
  std::ifstream stream(file);
  const ordered_json summary = ordered_json::parse(stream, nullptr, false);
  if (summary.is_discarded()) {
    row.problem = "the run gave no summary (its message is above)";
    return;
  }
  try {
    take(summary, row);
  } catch (const ordered_json::exception&) {
    row.problem = "the run ended before its loop began (its message is above)";
  }
}

std::string write_config(const TuningRow& row) {
  for (const tools::ConfigLayer& layer : tools::config_layers("")) {
    if (layer.name == "user") {
      char rate[32];
      std::snprintf(rate, sizeof rate, "%g", row.rate_Hz);
      tools::set_in_config(
          layer.file,
          {{"run.rate", rate},
           {"run.fill-budget", std::to_string(row.fill_budget)},
           {"run.method", tools::toml_text({row.method}, tools::ConfigType::kText, false)}});
      return layer.file;
    }
  }
  throw std::runtime_error("--write: no home folder for the user's configuration; set HOME");
}

ordered_json json_of(const TuningRow& row, const tools::TuningTolerance& tolerance) {
  return {{"method", row.method},
          {"rate_Hz", row.rate_Hz},
          {"fill_budget", row.fill_budget},
          {"error_percent", row.error_percent},
          {"missed_percent", row.missed_percent},
          {"period_p99_us", row.period_p99_us},
          {"compute_p50_us", row.compute_p50_us},
          {"compute_p99_us", row.compute_p99_us},
          {"backlog_percent", row.backlog_percent},
          {"processor_percent", row.processor_percent()},
          {"objection", tools::objection(row, tolerance)}};
}

}  // namespace

void add_tune(CLI::App& app, TuneOptions& o, std::function<int()>& action) {
  CLI::App& tune = *app.add_subcommand(
      "tune", "Find the cheapest rate, fill budget and method that are good enough here");
  tune.add_option("--device", o.device, "As of run")->capture_default_str();
  tune.add_option("--profile", o.profile, "Of an attached device, as of run");
  tune.add_option("--scene", o.scene, "Object to feel: " + scene_help())
      ->check(scene_check())
      ->capture_default_str();
  tune.add_option("--motion", o.motion, "Motion of the emulated hand, as of run")
      ->capture_default_str();
  tune.add_option("--rates", o.rates_Hz, "Servo rates to try, separated by commas")
      ->delimiter(',')
      ->check(CLI::Range(100.0, 4000.0))
      ->type_name("FLOAT Hz")
      ->capture_default_str();
  tune.add_option("--fill-budgets", o.fill_budgets, "Fill budgets to try for methods with a grid")
      ->delimiter(',')
      ->check(CLI::Range(1, 1000000))
      ->type_name("INT vertices")
      ->capture_default_str();
  tune.add_option("--methods", o.methods,
                  "Methods to try, separated by ';', with changes to their options, e.g. "
                  "\"forcegrid;forcegrid cells=25,25,25\"")
      ->delimiter(';')
      ->capture_default_str();
  tune.add_option("--time", o.time_s, "How long it may take in all")
      ->check(CLI::Range(1.0, 86400.0))
      ->type_name("FLOAT s")
      ->capture_default_str();
  tune.add_option("--error-percent", o.error_percent,
                  "Tolerated RMS error after the first second of contact, of the RMS of the force")
      ->check(CLI::Range(0.0, 1000.0))
      ->type_name("FLOAT %")
      ->capture_default_str();
  tune.add_option("--missed-percent", o.missed_percent, "Tolerated share of missed deadlines")
      ->check(CLI::Range(0.0, 100.0))
      ->type_name("FLOAT %")
      ->capture_default_str();
  tune.add_option("--compute-percent", o.compute_percent,
                  "Tolerated compute time of a cycle at the 99th percentile, of the period")
      ->check(CLI::Range(0.1, 1e6))
      ->type_name("FLOAT %")
      ->capture_default_str();
  tune.add_option("--out", o.out, "Folder for tuning.csv, .svg and .png")->capture_default_str();
  tune.add_flag("--write", o.write, "Write the proposal into the user's configuration")
      ->configurable(false);
  tune.footer("Exit status: 0 a setting is proposed, 3 none meets the tolerance.");
  tune.callback([&o, &action] { action = [&o] { return tune_command(o); }; });
}

int tune_command(const TuneOptions& options) {
  check_rates(options);
  std::vector<TuningRow> rows = rows_to_measure(options);
  const double seconds = options.time_s / static_cast<double>(rows.size()) - kOverhead_s;
  if (seconds < kShortestRun_s) {
    const double needed_s = (kShortestRun_s + kOverhead_s) * static_cast<double>(rows.size());
    throw std::runtime_error("--time " + std::to_string(std::lround(options.time_s)) + ": " +
                             std::to_string(rows.size()) + " settings need " +
                             std::to_string(std::lround(needed_s)) +
                             " s; give that, or fewer --methods, --rates or --fill-budgets");
  }
  std::FILE* const out = options.json.on_stdout() ? stderr : stdout;
  std::fprintf(out, "%-32s %7s %7s %9s %9s %9s %9s\n", "method", "Hz", "budget", "error %",
               "missed %", "compute us", "CPU %");
  for (TuningRow& row : rows) {
    measure(options, seconds, row);
    if (StopRequest::stop()) {
      throw std::runtime_error("stopped; nothing is proposed");
    }
    std::fprintf(out, "%-32s %7.0f %7d ", row.method.c_str(), row.rate_Hz, row.fill_budget);
    if (row.problem.empty()) {
      std::fprintf(out, "%9.3f %9.3f %9.1f %9.3f\n", row.error_percent, row.missed_percent,
                   row.compute_p50_us, row.processor_percent());
    } else {
      std::fprintf(out, "%s\n", row.problem.c_str());
    }
    std::fflush(out);
  }
  const tools::TuningTolerance tolerance{options.error_percent, options.missed_percent,
                                         0.01 * options.compute_percent};
  const tools::TuningChoice choice = tools::choose(rows, tolerance);
  const std::vector<std::string> files = tools::draw_tuning(options.out, rows, choice);
  std::fprintf(out, "%s\n", choice.reason.c_str());
  std::string written;
  if (options.write && choice.chosen) {
    written = write_config(rows[*choice.chosen]);
    std::fprintf(out, "Wrote %s\n", written.c_str());
  }
  ordered_json list = ordered_json::array();
  for (const TuningRow& row : rows) {
    list.push_back(json_of(row, tolerance));
  }
  const auto row_or_null = [&](const std::optional<std::size_t>& index) {
    return index ? json_of(rows[*index], tolerance) : ordered_json(nullptr);
  };
  write_json(options.json, ordered_json{{"chosen", row_or_null(choice.chosen)},
                                        {"next_cheaper", row_or_null(choice.next_cheaper)},
                                        {"reason", choice.reason},
                                        {"seconds_each", seconds},
                                        {"settings", list},
                                        {"files", files},
                                        {"written", written}}
                               .dump(2));
  return choice.chosen ? 0 : kNoneMeets;
}

}  // namespace forcegrid::cli
