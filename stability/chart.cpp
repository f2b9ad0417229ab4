// SPDX-License-Identifier: Apache-2.0
#include "stability/chart.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>

#include "evaluation/charts/row_file.h"
#include "evaluation/scenarios/scenarios.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/parallel_jobs.h"
#include "stability/chart_numbers.h"
#include "stability/chart_rows.h"
#include "stability/scenes.h"
#include "stability/theory.h"

namespace forcegrid::stability {
namespace {

using std::chrono::steady_clock;

// Increase when the meaning of a row changes.
constexpr int kRowVersion = 2;

MethodVariant variant_of(const std::string& method) {
  MethodOptions base;
  base.grid.max_W = {0.16, 0.12, 0.12};
  base.grid.cells.setConstant(49);
  return parse_method_variant(method, base);
}

std::string key_of(const StabilityCase& cell, const std::string& table_key, std::uint64_t seed) {
  return cell.text() + '/' + table_key + '/' + std::to_string(seed) + '/' +
         std::to_string(kRowVersion);
}

// Makes a separate method and object for each run.
class CaseRunner {
 public:
  CaseRunner(const StabilityCase& cell, const evaluation::ForceTable& table, std::uint64_t seed)
      : cell_(cell), table_(table) {
    if (cell.method != kExact) {
      variant_ = variant_of(cell.method);
    }
    setup_ = setup_of(cell, variant_ && method()->needs().stiffness, seed);
  }

  LoopResult run(double stiffness_N_per_m) const {
    const std::unique_ptr<VirtualObject> object = object_of(stiffness_N_per_m);
    const std::unique_ptr<ForceMethod> made = variant_ ? method() : nullptr;
    if (cell_.part == part::kOpen) {
      const evaluation::Trajectory human("random", setup_.seed);
      return run_open_loop(setup_, human, *object, made.get());
    }
    return run_closed_loop(setup_, *object, made.get());
  }

 private:
  std::unique_ptr<ForceMethod> method() const {
    return make_force_method(variant_->name, variant_->options);
  }
  std::unique_ptr<VirtualObject> object_of(double stiffness_N_per_m) const {
    if (cell_.scene == "spring") {
      return std::make_unique<LinearObject>(stiffness_N_per_m, setup_.contact_point_W);
    }
    BaseField field{table_, stiffness_N_per_m, setup_.contact_point_W};
    if (cell_.part == part::kOpen) {
      field.first_event_s = kOpenLoopFirstEvent_s;
      field.second_event_s = kOpenLoopSecondEvent_s;
    }
    return scene_of(cell_.scene).make(field);
  }

  const StabilityCase& cell_;
  const evaluation::ForceTable& table_;
  std::optional<MethodVariant> variant_;
  LoopSetup setup_;
};

// Works through cells on several threads.
class Pool {
 public:
  Pool(const StabilityChartOptions& options, const evaluation::ForceTable& table,
       std::size_t done_before)
      : options_(options), table_(table), done_before_(done_before) {}

  void add(const StabilityCase& cell, std::string key, std::optional<StabilityRow>& place) {
    cells_.push_back({&cell, std::move(key), &place});
  }

  // Cells that can't be judged leave their place empty.
  void run(evaluation::RowFile& file, std::vector<NotJudgedCell>& not_judged) {
    rt::JobOptions jobs{.threads = options_.jobs};
    jobs.cancel = options_.cancel;
    if (options_.progress) {
      jobs.progress = [this](double done, double remaining_s) {
        const auto before = static_cast<double>(done_before_);
        const auto now = static_cast<double>(cells_.size());
        options_.progress("stability", (before + done * now) / (before + now), remaining_s);
      };
    }
    std::mutex mutex;  // of the file and of `not_judged`
    const bool finished = rt::run_jobs(cells_.size(), jobs, [&](rt::Job& job) {
      const Cell& cell = cells_[job.number()];
      std::vector<NotJudgedCell> failed;
      *cell.place = try_case(*cell.cell, table_, options_.seed, failed);
      const std::lock_guard lock(mutex);
      if (!*cell.place) {
        not_judged.push_back(failed.front());
        return true;
      }
      nlohmann::ordered_json json = to_json(**cell.place);
      json["key"] = cell.key;
      file.keep(std::move(json));
      return true;
    });
    if (!finished) {
      throw evaluation::Stopped();
    }
  }

 private:
  struct Cell {
    const StabilityCase* cell;
    std::string key;
    std::optional<StabilityRow>* place;
  };

  const StabilityChartOptions& options_;
  const evaluation::ForceTable& table_;
  std::vector<Cell> cells_;
  std::size_t done_before_;
};

evaluation::BuiltTable table_of(const StabilityChartOptions& options, const std::string& scene) {
  evaluation::TableOptions table;
  table.threads = options.jobs;
  table.cache = options.cache;
  table.cancel = options.cancel;
  if (options.progress) {
    table.progress = [&options, scene](double done, double remaining_s) {
      options.progress("force table of " + scene, done, remaining_s);
    };
  }
  return evaluation::build_table(evaluation::make_mesh(evaluation::chart_scene(scene)), table);
}

SweepOptions sweep_options(const StabilityChartOptions& options, const SweptDevice& device) {
  SweepOptions sweep;
  sweep.device = device.profile;
  sweep.methods = {options.default_method};
  for (const char* const other : {"hold", "rls"}) {
    if (options.default_method != other) {
      sweep.methods.emplace_back(other);
    }
  }
  sweep.runs = std::max(1, static_cast<int>(std::lround(options.swept_runs * device.part)));
  sweep.seed = options.seed;
  sweep.jobs = options.jobs;
  sweep.cancel = options.cancel;
  if (options.progress) {
    sweep.progress = [&options, what = "fault sweep of " + sweep.device](double done,
                                                                         double remaining_s) {
      options.progress(what, done, remaining_s);
    };
  }
  return sweep;
}

void sweep_devices(const StabilityChartOptions& options, StabilityChart& chart) {
  for (const SweptDevice& device : kSweptDevices) {
    const auto runs = sweep_faults(sweep_options(options, device));
    const auto lines = sweep_table(runs, profiles::load_device_profile(device.profile));
    chart.sweep.insert(chart.sweep.end(), runs.begin(), runs.end());
    chart.swept.insert(chart.swept.end(), lines.begin(), lines.end());
  }
}

}  // namespace

StabilityRow run_case(const StabilityCase& cell, const evaluation::ForceTable& table,
                      std::uint64_t seed) {
  const CaseRunner runner(cell, table, seed);
  StabilityRow row;
  row.cell = cell;
  row.run = runner.run(cell.stiffness_N_per_m);
  if (cell.find_limit) {
    row.limit = find_limit([&](double stiffness) { return runner.run(stiffness).behaviour; });
  } else {
    row.limit.largest_stable_N_per_m = row.limit.smallest_unstable_N_per_m = std::nan("");
  }
  return row;
}

std::optional<StabilityRow> try_case(const StabilityCase& cell, const evaluation::ForceTable& table,
                                     std::uint64_t seed, std::vector<NotJudgedCell>& not_judged) {
  try {
    return run_case(cell, table, seed);
  } catch (const evaluation::ChartError& error) {
    not_judged.push_back({cell, error.what()});
  } catch (const std::invalid_argument& error) {
    not_judged.push_back({cell, error.what()});
  }
  return std::nullopt;
}

double eigenvalue_limit_of(const StabilityCase& cell) {
  const LoopSetup setup = setup_of(cell, false, 1);
  const double device_s = setup.timing.count_age_s + setup.timing.actuation_delay_s;
  const double cycle_s = 1.0 / cell.servo_rate_Hz;
  const double tick_s = 1.0 / setup.network.simulator_rate_Hz;
  SampledSpring spring =
      cell.method == kExact
          ? sampled_spring(setup.device, setup.hand, cycle_s, device_s)
          : sampled_spring(setup.device, setup.hand, tick_s, tick_s + cell.delay_s + device_s);
  spring.virtual_damping_N_s_per_m = cell.virtual_damping_N_s_per_m;
  return eigenvalue_limit_N_per_m(spring);
}

StabilityChart make_stability_chart(const StabilityChartOptions& options) {
  const auto start = steady_clock::now();
  std::vector<StabilityCase> cells =
      !options.cells.empty() ? options.cells
                             : chart_cases({options.quick, options.methods, options.default_method,
                                            options.parts, options.hands});
  for (const StabilityCase& cell : cells) {
    if (cell.method != kExact) {
      const MethodVariant variant = variant_of(cell.method);
      check_method_name(variant.name);
    }
  }
  const bool sweeps =
      options.cells.empty() && options.shard.whole() &&
      (options.parts.empty() ||
       std::find(options.parts.begin(), options.parts.end(), part::kSweep) != options.parts.end());
  if (cells.empty() && !sweeps && options.shard.whole()) {
    throw evaluation::ChartError(
        "nothing to chart: no selected part uses a selected hand; leave out --parts or "
        "--hands");
  }
  std::size_t number = 0;
  std::erase_if(cells, [&number, all = cells.size(), &options](const StabilityCase& /*cell*/) {
    return !options.shard.has(number++, all);
  });
  std::map<std::string, StabilityRow> before;
  evaluation::RowFile file(options.out, options.program, [&](const nlohmann::ordered_json& json) {
    before[json.at("key").get<std::string>()] = row_from_json(json);
  });
  StabilityChart chart;
  chart.scene = options.quick ? "small" : "block";
  const evaluation::BuiltTable built = table_of(options, chart.scene);
  chart.table_stiffness_N_per_m = TableObject::normal_stiffness_N_per_m(built.table);
  std::vector<std::optional<StabilityRow>> rows(cells.size());
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto found = before.find(key_of(cells[i], built.key, options.seed));
    if (found != before.end()) {
      rows[i] = found->second;
      ++chart.rows_kept;
    }
  }
  Pool pool(options, built.table, chart.rows_kept);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const std::string key = key_of(cells[i], built.key, options.seed);
    if (before.find(key) == before.end()) {
      pool.add(cells[i], key, rows[i]);
    }
  }
  pool.run(file, chart.not_judged);
  for (std::optional<StabilityRow>& row : rows) {
    if (row) {
      chart.rows.push_back(std::move(*row));
    }
  }
  if (chart.rows.empty() && !chart.not_judged.empty()) {
    throw evaluation::ChartError(
        "none of the " + std::to_string(chart.not_judged.size()) +
        " cells could be judged; the first: " + chart.not_judged.front().reason);
  }
  if (sweeps) {
    sweep_devices(options, chart);
  }
  chart.numbers = numbers_of(chart, options.default_method);
  chart.elapsed_s = std::chrono::duration<double>(steady_clock::now() - start).count();
  return chart;
}

}  // namespace forcegrid::stability
