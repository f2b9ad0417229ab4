// SPDX-License-Identifier: Apache-2.0
#include "cli/tune_command.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <exception>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/scene_option.h"
#include "cli/common/stop_request.h"
#include "cli/common/tools_names.h"
#include "cli/run/run_setup.h"
#include "cli/tune_run.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "log/log.h"
#include "profiles/device_profile.h"
#include "tools/config_file.h"
#include "tools/tuning.h"
#include "tools/tuning_picture.h"
#include "tools/tuning_search.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::TuningRow;

constexpr int kNoneMeets = 3;
constexpr double kShortestRun_s = 6.0;  // 2 s until the touch, 1 s of learning, the rest is judged
constexpr double kOverhead_s = 4.0;     // starting, calibrating, reference forces
constexpr double kLongestRun_s = 20.0;
constexpr double kRuns = 12.0;    // number of runs that the time is planned for
constexpr double kChecked = 2.0;  // least number of runs: the path and one setting

// The device limits the rate to one report per bus frame.
void check_rates(const TuneOptions& options, const profiles::DeviceProfile& profile) {
  const double pace_Hz = 1e6 / profile.usb.frame_period_us;
  for (const double rate_Hz : options.rates_Hz) {
    if (rate_Hz > pace_Hz) {
      char text[300];
      std::snprintf(text, sizeof text,
                    "--rates %.0f: %s answers once per bus frame of %d us, at most %.0f times per "
                    "second; 2 and 4 kHz need a high-speed device, or simulated time (forcegrid "
                    "chart stability)",
                    rate_Hz, profile.name.c_str(), profile.usb.frame_period_us, pace_Hz);
      throw std::runtime_error(text);
    }
  }
}

// A method without a grid ignores the budget, so one value is enough.
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
        if (!tools::has_grid(method)) {
          rows.back().fill_budget = RunOptions().fill_budget;
          break;
        }
      }
    }
  }
  return rows;
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

ordered_json number(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}

ordered_json json_of(const TuningRow& row, const tools::TuningTolerance& tolerance) {
  ordered_json json = {{"method", row.method},
                       {"rate_Hz", row.rate_Hz},
                       {"fill_budget", row.fill_budget},
                       {"path_error_percent", number(row.path_error_percent)},
                       {"method_us", row.method_us},
                       {"method_percent", row.method_percent()},
                       {"method_at_timer_floor", row.at_timer_floor()},
                       {"stability_margin", number(row.stability_margin)},
                       {"measured", row.measured}};
  if (row.measured) {
    json["error_percent"] = row.error_percent;
    json["missed_percent"] = row.missed_percent;
    json["period_p99_us"] = row.period_p99_us;
    json["compute_p50_us"] = row.compute_p50_us;
    json["compute_p99_us"] = row.compute_p99_us;
    json["backlog_percent"] = row.backlog_percent;
  }
  json["objection"] = tools::objection(row, tolerance);
  return json;
}

void print_head(std::FILE* out) {
  std::fprintf(out, "%-32s %7s %7s %8s %8s %8s %8s %9s\n", "in the loop", "Hz", "budget", "margin",
               "error %", "missed %", "p99 us", "method %");
}

void print(std::FILE* out, const TuningRow& row) {
  std::fprintf(out, "%-32s %7.0f %7d %8.2f ", row.method.c_str(), row.rate_Hz, row.fill_budget,
               row.stability_margin);
  if (row.measured) {
    std::fprintf(out, "%8.3f %8.3f %8.1f %9.4f%s\n", row.error_percent, row.missed_percent,
                 row.compute_p99_us, row.method_percent(), row.at_timer_floor() ? " or less" : "");
  } else {
    std::fprintf(out, "%s\n", row.problem.empty() ? "not stable enough" : row.problem.c_str());
  }
  std::fflush(out);
}

// The search: tries the settings that are good enough on the path in the loop, the cheapest
// first, until one is good enough there.
class Search {
 public:
  Search(const TuneOptions& options, const profiles::DeviceProfile& profile, std::FILE* out)
      : options_(options),
        out_(out),
        tolerance_{options.error_percent, options.missed_percent, 0.01 * options.compute_percent,
                   0.01 * options.margin_percent},
        runs_{options.device,
              options.profile,
              options.scene,
              options.motion,
              options.hand,
              options.calibrated,
              options.out + "/tuning_run"},
        rows_(rows_to_measure(options)),
        run_s_(std::clamp(options.time_s / kRuns - kOverhead_s, kShortestRun_s, kLongestRun_s)),
        end_(std::chrono::steady_clock::now() +
             std::chrono::milliseconds(std::lround(1e3 * options.time_s))) {
    RunOptions run;
    base_ = method_options(run, profile, servo::WorkspaceMap());
    margin_.hand = options.hand;
    margin_.frame_period_us = profile.usb.frame_period_us;
    margin_.simulator_rate_Hz = run.simulator_rate_Hz;
  }

  void run() {
    judge_all();
    by_cost_.resize(rows_.size());
    std::iota(by_cost_.begin(), by_cost_.end(), std::size_t{0});
    std::sort(by_cost_.begin(), by_cost_.end(),
              [&](std::size_t a, std::size_t b) { return tools::cheaper(rows_[a], rows_[b]); });
    print_head(out_);
    for (const std::size_t i : by_cost_) {
      if (!tools::choose(rows_, tolerance_).chosen && worth_a_run(rows_[i])) {
        try_in_loop(rows_[i]);
      }
    }
    measure_more();
  }

  const std::vector<TuningRow>& rows() const { return rows_; }
  const tools::TuningTolerance& tolerance() const { return tolerance_; }
  double run_s() const { return run_s_; }

 private:
  static void check_stop() {
    if (StopRequest::stop()) {
      throw std::runtime_error("stopped; tune proposes nothing");
    }
  }

  __attribute__((format(printf, 2, 3))) void say_step(const char* format, ...) const {
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    std::vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    cli::say_step(options_.json, "tune", text);
  }

  void judge_all() {
    const double rate_Hz = *std::max_element(options_.rates_Hz.begin(), options_.rates_Hz.end());
    say_step("recording a path at %.0f Hz, %.0f s ...", rate_Hz, run_s_);
    line_.begin("Recording", run_s_ + kOverhead_s);
    const evaluation::Trace trace = record_path(runs_, rate_Hz, run_s_);
    line_.clear();
    check_stop();
    margin_.stiffest_N_per_m = tools::stiffest_N_per_m(trace);
    say_step("evaluating %zu settings on it; its largest stiffness is %.0f N/m ...", rows_.size(),
             margin_.stiffest_N_per_m);
    for (TuningRow& row : rows_) {
      line_.show("Evaluating",
                 static_cast<double>(&row - rows_.data()) / static_cast<double>(rows_.size()));
      tools::judge_on_path(trace, base_, row);
      check_stop();
    }
    line_.clear();
    say_what_is_too_quick();
  }

  void say_what_is_too_quick() const {
    const auto quick = std::count_if(rows_.begin(), rows_.end(), [](const TuningRow& row) {
      return row.problem.empty() && row.at_timer_floor();
    });
    if (quick > 0) {
      double floor_us = 0.0;
      for (const TuningRow& row : rows_) {
        floor_us = std::max(floor_us, row.timer_floor_us);
      }
      say_step(
          "%ld of them take less time than this computer's timer can tell from none; they count as "
          "its step, %g ns per cycle",
          static_cast<long>(quick), 1e3 * floor_us);
    }
  }

  bool time_for_a_run() const {
    return std::chrono::steady_clock::now() +
               std::chrono::milliseconds(std::lround(1e3 * (run_s_ + kOverhead_s))) <=
           end_;
  }

  bool worth_a_run(const TuningRow& row) const {
    return row.problem.empty() && std::isnan(row.stability_margin) && !row.measured &&
           time_for_a_run() && row.path_error_percent <= tolerance_.error_percent;
  }

  void try_in_loop(TuningRow& row) {
    const std::chrono::duration<double> left = end_ - std::chrono::steady_clock::now();
    line_.show("Trying " + row.method + " in the loop", 1.0 - left.count() / options_.time_s,
               left.count());
    if (margin_.stiffest_N_per_m > 0.0) {
      row.stability_margin = tools::stability_margin(margin_, base_, row);
    }
    if (!(row.stability_margin < tolerance_.stability_margin)) {
      measure_in_loop(runs_, run_s_, row);
    }
    line_.clear();
    check_stop();
    print(out_, row);
  }

  // While time remains, measures further settings in the loop: the next cheaper one, the chosen
  // method at other rates and budgets, the least of each kind, and the others that are good enough.
  void measure_more() {
    const tools::TuningChoice choice = tools::choose(rows_, tolerance_);
    if (!choice.chosen) {
      return;
    }
    if (choice.next_cheaper && !rows_[*choice.next_cheaper].measured &&
        std::isnan(rows_[*choice.next_cheaper].stability_margin) && time_for_a_run()) {
      try_in_loop(rows_[*choice.next_cheaper]);
    }
    for (TuningRow& row : rows_) {
      if (row.method == rows_[*choice.chosen].method && worth_a_run(row)) {
        try_in_loop(row);
      }
    }
    for (const tools::LeastVariant& found : tools::least_variants(rows_, tolerance_)) {
      if (worth_a_run(rows_[found.least])) {
        try_in_loop(rows_[found.least]);
      }
    }
    for (const std::size_t i : by_cost_) {
      if (worth_a_run(rows_[i])) {
        try_in_loop(rows_[i]);
      }
    }
  }

  const TuneOptions& options_;
  std::FILE* out_;
  ProgressLine line_;
  tools::TuningTolerance tolerance_;
  TuneRuns runs_;
  std::vector<TuningRow> rows_;
  std::vector<std::size_t> by_cost_;
  double run_s_;
  std::chrono::steady_clock::time_point end_;
  MethodOptions base_;
  tools::MarginLoop margin_;
};

std::string sentence_of(const tools::LeastVariant& found, const std::vector<TuningRow>& rows) {
  char text[400];
  const TuningRow& least = rows[found.least];
  std::snprintf(text, sizeof text, "%s, %.3g %%", tools::name_of(least).c_str(),
                least.path_error_percent);
  std::string sentence = text;
  if (found.next_smaller) {
    const TuningRow& smaller = rows[*found.next_smaller];
    std::snprintf(text, sizeof text, "; %s has %.3g %%", tools::name_of(smaller).c_str(),
                  smaller.path_error_percent);
    sentence += text;
  }
  return sentence;
}

void check_methods(const TuneOptions& options) {
  for (const std::string& method : options.methods) {
    static_cast<void>(parse_method_variant(method, MethodOptions()));
  }
}

void check_time(const TuneOptions& options) {
  const double needed_s = kChecked * (kShortestRun_s + kOverhead_s);
  if (options.time_s < needed_s) {
    throw std::runtime_error("--time " + std::to_string(std::lround(options.time_s)) +
                             ": recording a path and trying one setting take " +
                             std::to_string(std::lround(needed_s)) +
                             " s, each further setting half of that; give a longer --time");
  }
}

}  // namespace

void add_tune(Command& app, TuneOptions& o, std::function<int()>& action) {
  Command& tune = app.add_subcommand("tune", tools_description("tune"));
  tune.add_option("--device", o.device, "As in run")->show_default();
  tune.add_option("--profile", o.profile, "Profile of an attached device, as in run");
  tune.add_option("--scene", o.scene, "Object to feel: " + scene_help())
      ->check(scene_check())
      ->show_default();
  tune.add_option("--motion", o.motion, "Motion of the emulated hand, as in run")->show_default();
  tune.add_option(
          "--hand", o.hand,
          "Hand that holds the device: of the emulated device, as in run, and in simulated time")
      ->check(one_of({"firm", "light"}))
      ->show_default();
  tune.add_flag("--calibrated", o.calibrated,
                "The encoder counters are already valid: no pose, no button, in any run")
      ->not_in_config();
  tune.add_option("--rates", o.rates_Hz, "Servo rates to try, separated by commas")
      ->separated_by(',')
      ->check(between(100.0, 4000.0))
      ->type_name("FLOAT Hz")
      ->show_default();
  tune.add_option("--fill-budgets", o.fill_budgets, "Fill budgets to try for methods with a grid")
      ->separated_by(',')
      ->check(whole_between(1, 1000000))
      ->type_name("INT vertices")
      ->show_default();
  tune.add_option("--methods", o.methods,
                  "Methods to try, separated by ';', with changes to their options, e.g. "
                  "\"forcegrid cells=25;forcegrid\"")
      ->separated_by(';')
      ->show_default();
  tune.add_option("--time", o.time_s,
                  "Time limit for everything; with more time, more settings are tried in the loop")
      ->check(between(1.0, 86400.0))
      ->type_name("FLOAT s")
      ->show_default();
  tune.add_option(
          "--error-percent", o.error_percent,
          "Tolerated RMS error after the first second of contact, relative to the RMS force")
      ->check(between(0.0, 1000.0))
      ->type_name("FLOAT %")
      ->show_default();
  tune.add_option("--missed-percent", o.missed_percent, "Tolerated share of missed deadlines")
      ->check(between(0.0, 100.0))
      ->type_name("FLOAT %")
      ->show_default();
  tune.add_option("--compute-percent", o.compute_percent,
                  "Tolerated compute time per cycle at the 99th percentile, relative to the period")
      ->check(between(0.1, 1e6))
      ->type_name("FLOAT %")
      ->show_default();
  tune.add_option(
          "--margin-percent", o.margin_percent,
          "Stiffness up to which the simulated loop must be stable, relative to the stiffest on "
          "the path")
      ->check(between(0.0, 1e6))
      ->type_name("FLOAT %")
      ->show_default();
  tune.add_option("--out", o.out, "Folder for tuning.csv, .svg and .png")->show_default();
  tune.add_flag("--write", o.write, "Write the proposal into the user's configuration")
      ->not_in_config();
  tune.footer(
      "Exit status: 0 a setting is proposed, 3 none meets the tolerance. A picture that can't be "
      "drawn is a warning and changes neither.");
  tune.callback([&o, &action] { action = [&o] { return tune_command(o); }; });
}

int tune_command(const TuneOptions& options) {
  const profiles::DeviceProfile profile =
      profiles::load_device_profile(profile_name_of(options.device, options.profile));
  check_rates(options, profile);
  check_methods(options);
  check_time(options);
  const ResultText text(options.json, "tune");
  std::FILE* const out = text.stream();
  Search search(options, profile, out);
  search.run();
  const std::vector<TuningRow>& rows = search.rows();
  const tools::TuningTolerance& tolerance = search.tolerance();
  const tools::TuningChoice choice = tools::choose(rows, tolerance);
  ordered_json leasts = ordered_json::array();
  for (const tools::LeastVariant& found : tools::least_variants(rows, tolerance)) {
    leasts.push_back(sentence_of(found, rows));
    std::fprintf(out, "least of its kind on the path: %s\n",
                 leasts.back().get<std::string>().c_str());
  }
  std::fprintf(out, "%s\n", choice.reason.c_str());
  std::string written;
  if (options.write && choice.chosen) {
    written = write_config(rows[*choice.chosen]);
    std::fprintf(out, "Wrote %s\n", written.c_str());
  }
  // The proposal stands whatever becomes of its picture. A failed table loses measurements, which
  // is an error, but only after the JSON has them.
  std::vector<std::string> files;
  std::exception_ptr not_written;
  std::string picture_problem;
  try {
    files.push_back(tools::write_tuning_csv(options.out, rows, choice));
  } catch (...) {
    not_written = std::current_exception();
  }
  try {
    const std::vector<std::string> pictures =
        tools::draw_tuning(options.out, rows, choice, tolerance);
    files.insert(files.end(), pictures.begin(), pictures.end());
  } catch (const std::runtime_error& error) {
    picture_problem = error.what();
    log::warn("tune", std::string("no picture of the tuning: ") + error.what() +
                          ". The result above is complete.");
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
                                        {"least_of_each_kind", leasts},
                                        {"seconds_each", search.run_s()},
                                        {"settings", list},
                                        {"files", files},
                                        {"picture_problem", picture_problem.empty()
                                                                ? ordered_json(nullptr)
                                                                : ordered_json(picture_problem)},
                                        {"written", written}}
                               .dump(2));
  if (not_written) {
    std::rethrow_exception(not_written);
  }
  return choice.chosen ? 0 : kNoneMeets;
}

}  // namespace forcegrid::cli
