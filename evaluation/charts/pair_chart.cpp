// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/pair_chart.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>

#include "evaluation/files/error.h"
#include "evaluation/judge/baseline_cost.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/scenarios/scenarios.h"
#include "evaluation/traces/trace_workspace.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/pair_methods.h"
#include "rt/parallel_jobs.h"

namespace forcegrid::evaluation {
namespace {

namespace fs = std::filesystem;

// Where uncoupled methods have less, there is little coupling to learn.
constexpr double kCoupled_percent = 1.0;

struct Cell {
  std::string scene;
  std::string pair;
  PairTrace trace;
};

std::vector<Cell> cells_of(const PairChartOptions& options) {
  std::vector<Cell> cells;
  for (const std::string& scene : options.scenes) {
    for (const std::string& pair : options.pairs.empty() ? pair_motion_names() : options.pairs) {
      static_cast<void>(PairMotion(pair, options.seed));  // refuses an unknown one
      cells.push_back({chart_scene(scene).name, pair, {}});
    }
  }
  return cells;
}

std::vector<MethodVariant> variants_of(const PairChartOptions& options) {
  std::vector<std::string> texts =
      options.methods.empty() ? default_pair_chart_methods() : options.methods;
  if (std::find(texts.begin(), texts.end(), options.goals_for) == texts.end()) {
    texts.push_back(options.goals_for);
  }
  MethodOptions base;
  base.grid = default_trace_workspace();
  std::vector<MethodVariant> variants;
  for (const std::string& text : texts) {
    try {
      variants.push_back(parse_pair_variant(text, base));
      make_pair_force_method(variants.back().name, variants.back().options);
    } catch (const std::invalid_argument& error) {
      throw ChartError(error.what());
    }
  }
  return variants;
}

PairReference solve(const Cell& cell, const PairChartOptions& options, rt::Job& job) {
  const ChartScene& scene = chart_scene(cell.scene);
  PairTraceOptions trace;
  trace.seconds = options.seconds;
  trace.delay_s = options.delay_s;
  trace.noise_N = options.noise_N;
  trace.stiffness = options.stiffness;
  trace.patch_radius_m = scene.patch_radius_m;
  trace.cache = options.cache;
  trace.progress = [&job](double done) { job.report(done); };
  trace.cancel = &job.stop_flag();
  return make_pair_trace(make_mesh(scene), PairMotion(cell.pair, options.seed), trace,
                         options.seed);
}

void make_traces(std::vector<Cell>& cells, const PairChartOptions& options, PairChart& chart) {
  const fs::path folder = options.out / "traces";
  make_trace_folder(folder);
  std::vector<std::size_t> unconverged(cells.size(), 0);
  std::vector<std::size_t> branch_changes(cells.size(), 0);
  rt::JobOptions jobs{.threads = options.jobs};
  jobs.progress = [&options](double done, double remaining_s) {
    if (options.progress) {
      options.progress("Solving traces", done, remaining_s);
    }
  };
  jobs.cancel = options.cancel;
  const bool finished = rt::run_jobs(cells.size(), jobs, [&](rt::Job& job) {
    Cell& cell = cells[job.number()];
    try {
      PairReference reference = solve(cell, options, job);
      unconverged[job.number()] = reference.unconverged;
      branch_changes[job.number()] = reference.branch_changes;
      cell.trace = std::move(reference.trace);
    } catch (const Stopped&) {
      return false;
    }
    write_pair_trace((folder / (file_name_part(cell.scene) + "-" + cell.pair + ".csv.gz")).string(),
                     cell.trace);
    return true;
  });
  if (!finished) {
    throw Stopped();
  }
  for (std::size_t i = 0; i < cells.size(); ++i) {
    chart.unconverged += unconverged[i];
    chart.branch_changes += branch_changes[i];
    if (options.say && unconverged[i] + branch_changes[i] > 0) {
      options.say("Note: " + cells[i].scene + ", " + cells[i].pair + ": " +
                  std::to_string(unconverged[i]) + " instants did not converge, " +
                  std::to_string(branch_changes[i]) + " left their branch of equilibria");
    }
  }
}

void judge_all(const std::vector<Cell>& cells, const std::vector<MethodVariant>& variants,
               const PairChartOptions& options, PairChart& chart) {
  for (const Cell& cell : cells) {
    for (const MethodVariant& variant : variants) {
      if (options.cancel != nullptr && options.cancel->load()) {
        throw Stopped();
      }
      if (options.progress) {
        options.progress("Evaluating " + variant.text,
                         static_cast<double>(chart.rows.size()) /
                             static_cast<double>(cells.size() * variants.size()),
                         0.0);
      }
      MethodOptions with_box = variant.options;
      with_box.grid = workspace_of(cell.trace, with_box.grid);
      PairChartRow row{cell.scene, cell.pair, variant.text, is_pair_method(variant.name), {}, 0.0};
      const auto method = make_pair_force_method(variant.name, with_box);
      row.trilinear_read_ns = bare_trilinear_read_ns();
      row.verdict = judge_pair(*method, cell.trace);
      chart.rows.push_back(std::move(row));
    }
  }
}

// The goals' scene is the last one, which is the largest unless others were asked for.
class Goals {
 public:
  Goals(const PairChart& chart, const PairChartOptions& options)
      : chart_(chart), options_(options), scene_(chart_scene(options.scenes.back()).name) {}

  std::vector<PairChartNumber> all() const {
    return {{"error of both tools after 1 s, geometric mean over the pairs of motions",
             geometric_mean_percent(chart_, scene_, options_.goals_for), 0.5, "%", scene_},
            most("error relative to the best uncoupled method, where that has above 1 %", 1.0 / 3.0,
                 "", [this](const PairChartRow& row) { return relative_error(row); }),
            most("query for both tools, in bare trilinear reads", 20.0, "",
                 [](const PairChartRow& row) { return row.query_reads(); }),
            most("memory", 20.0, "MB", [](const PairChartRow& row) {
              return 1e-6 * static_cast<double>(row.verdict.memory_bytes);
            })};
  }

 private:
  double relative_error(const PairChartRow& row) const {
    double best_percent = std::numeric_limits<double>::infinity();
    for (const PairChartRow& other : chart_.rows) {
      if (!other.coupled && other.scene == row.scene && other.pair == row.pair) {
        best_percent = std::min(best_percent, other.verdict.together.after_1s.rms_percent);
      }
    }
    return std::isfinite(best_percent) && best_percent > kCoupled_percent
               ? row.verdict.together.after_1s.rms_percent / best_percent
               : std::numeric_limits<double>::quiet_NaN();
  }

  // The largest of the rows' figures that are known.
  template <typename Figure>
  PairChartNumber most(const char* name, double goal, const char* unit,
                       const Figure& figure) const {
    PairChartNumber number{name, std::numeric_limits<double>::quiet_NaN(), goal, unit, ""};
    for (const PairChartRow& row : chart_.rows) {
      if (row.scene != scene_ || row.method != options_.goals_for) {
        continue;
      }
      const double value = figure(row);
      if (std::isfinite(value) && !(value <= number.measured)) {
        number.measured = value;
        number.worst = row.pair;
      }
    }
    return number;
  }

  const PairChart& chart_;
  const PairChartOptions& options_;
  std::string scene_;
};

}  // namespace

const std::vector<std::string>& default_pair_chart_methods() {
  static const std::vector<std::string> all{"hold", "forcegrid",    "rls",        "kriging",
                                            "auto", "forcegrid-6d", "kriging-6d", "auto-6d"};
  return all;
}

double geometric_mean_percent(const PairChart& chart, const std::string& scene,
                              const std::string& method) {
  double sum = 0.0;
  int count = 0;
  for (const PairChartRow& row : chart.rows) {
    if (row.scene == scene && row.method == method) {
      sum += std::log(row.verdict.together.after_1s.rms_percent);
      ++count;
    }
  }
  return count > 0 ? std::exp(sum / count) : std::numeric_limits<double>::quiet_NaN();
}

PairChart make_pair_chart(const PairChartOptions& options) {
  if (options.scenes.empty()) {
    throw ChartError("chart of two tools: no scene; give --scenes, or leave it out");
  }
  const std::vector<MethodVariant> variants = variants_of(options);  // before anything is solved
  std::vector<Cell> cells = cells_of(options);
  PairChart chart;
  make_traces(cells, options, chart);
  judge_all(cells, variants, options, chart);
  chart.numbers = Goals(chart, options).all();
  return chart;
}

}  // namespace forcegrid::evaluation
