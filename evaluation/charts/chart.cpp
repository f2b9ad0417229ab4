// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "evaluation/charts/chart_plan.h"
#include "evaluation/charts/chart_rows.h"
#include "evaluation/charts/chart_summary.h"
#include "evaluation/judge/baseline_cost.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/motions/variation.h"
#include "evaluation/scenarios/network.h"
#include "evaluation/scenarios/scenarios.h"
#include "forcegrid/methods.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/direct_method.h"

namespace forcegrid::evaluation {
namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

using Eigen::Vector3d;

constexpr double kComparedEvery_s = 0.1;
constexpr int kRandomComparisons = 60;
constexpr double kLargestDifference_percent = 0.1;
constexpr double kTouchKnown_s = 0.2;
// Their percentiles are of the least that each cycle took; a quick chart has the time for one.
constexpr int kSplitRuns = 5;
// Increase when the meaning of a row changes.
constexpr std::uint64_t kRowVersion = 3;

std::string row_key(const ChartOptions& options, const std::string& scene,
                    const std::string& table_key, const std::string& trajectory,
                    const NetworkCondition& condition, const std::string& method) {
  ContentHash hash;
  hash.add(kRowVersion);
  hash.add(options.program);
  hash.add(scene);
  hash.add(table_key);
  hash.add(options.seed);
  hash.add(trajectory);
  hash.add(condition.name);
  for (const double value : {condition.simulator_rate_Hz, condition.delay_s, condition.jitter_s,
                             condition.loss, condition.noise_N, condition.requests_per_s,
                             condition.stiffness ? 1.0 : 0.0, kChartServoRate_Hz}) {
    hash.add(value);
  }
  hash.add(method);
  return hash.text();
}

void check_stop(const ChartOptions& options) {
  if (options.cancel != nullptr && *options.cancel) {
    throw Stopped();
  }
}

void say(const ChartOptions& options, const std::string& text) {
  if (options.say) {
    options.say(text);
  }
}

std::string rounded(double value, const char* format) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

struct Object {
  ChartScene scene;
  KnownObject known;
  ForceTable table;
  ChartTable facts;
};

TableOptions table_options(const ChartOptions& options, const ChartScene& scene,
                           const std::string& what) {
  TableOptions table;
  table.lattice = options.lattice;
  table.patch_radius_m = scene.patch_radius_m;
  table.threads = options.jobs;
  table.cache = options.cache;
  table.cancel = options.cancel;
  if (options.progress) {
    table.progress = [&options, what](double done, double remaining_s) {
      options.progress(what, done, remaining_s);
    };
  }
  return table;
}

// Those of `displacements_W` that a table covers.
std::vector<Vector3d> covered(const ForceTable& table, std::vector<Vector3d> displacements_W) {
  std::erase_if(displacements_W, [&table](const Vector3d& each) { return !table.contains(each); });
  return displacements_W;
}

Object make_object(const ChartOptions& options, const std::string& name) {
  const ChartScene& scene = chart_scene(name);
  KnownObject known = known_object(scene);
  const simulator::SpringMesh& mesh = known.mesh;
  const TableOptions building = table_options(options, scene, "force table of " + name);
  BuiltTable built = build_table(mesh, building);
  ChartTable facts;
  facts.scene = scene.name;
  facts.title = scene.title;
  facts.key = built.key;
  facts.from_cache = built.from_cache;
  facts.solved_s = built.elapsed_s;
  facts.stiffness_N_per_m = -built.table.at(Vector3d::Zero()).stiffness_W(2, 2);
  const TableOptions comparing = table_options(options, scene, "live solves of " + name);
  facts.along_motion = compare_with_live(
      built.table, mesh,
      covered(built.table, displacements_along_motion(options.seed, kComparedEvery_s)), comparing);
  facts.at_random = compare_with_live(
      built.table, mesh, random_displacements(options.lattice, options.seed, kRandomComparisons),
      comparing);
  say(options, name + ": force table " +
                   (built.from_cache ? std::string("from the cache")
                                     : "solved in " + rounded(built.elapsed_s, "%.0f s")) +
                   "; differs from live solves by " +
                   rounded(facts.along_motion.rms_percent, "%.4f %% (RMS) at ") +
                   std::to_string(facts.along_motion.positions) + " positions of a motion, " +
                   rounded(facts.at_random.rms_percent, "%.4f %% at ") +
                   std::to_string(facts.at_random.positions) + " random ones (largest " +
                   rounded(1e3 * facts.at_random.max_N, "%.2f mN)"));
  if (!(facts.along_motion.rms_percent < kLargestDifference_percent)) {
    say(options, "WARNING: " + name + ": the table differs from live solves by more than " +
                     rounded(kLargestDifference_percent, "%.1f %%") +
                     " along a motion; smaller errors are meaningless");
  }
  if (built.unconverged > 0) {
    say(options, "WARNING: " + name + ": " + std::to_string(built.unconverged) +
                     " of the table's nodes did not reach the solver's tolerance");
  }
  return {scene, std::move(known), std::move(built.table), std::move(facts)};
}

// Time kTouchKnown_s after the tool first touches a wall; infinity: it never does.
double wall_known_s(const ChartScene& scene, const Trace& trace) {
  for (const ServoInstant& instant : trace.servo) {
    for (const Wall& wall : scene.extras.walls) {
      if (wall.depth_m(instant.position_W - first_contact_point_W()) > 0.0) {
        return instant.time_s + kTouchKnown_s;
      }
    }
  }
  return std::numeric_limits<double>::infinity();
}

double rms_error_percent_from(double begin_s, const Trace& trace, const Verdict& verdict) {
  double sum_N2 = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    if (trace.servo[i].time_s >= begin_s) {
      sum_N2 += (verdict.forces_W[i] - trace.servo[i].force_W).squaredNorm();
      ++count;
    }
  }
  return count == 0
             ? std::numeric_limits<double>::quiet_NaN()
             : 100.0 * std::sqrt(sum_N2 / static_cast<double>(count)) / verdict.reference_rms_N;
}

// `direct` and the rivals have no work to split.
SplitCost split_cost(const Object& object, const Trace& trace, JudgeOptions judging,
                     const ChartMethod& method, const Verdict& at_once, int runs) {
  if (method.direct) {
    return {at_once.cycle_ns, at_once.cycle_ns_p99, at_once.cycle_ns_p999,
            at_once.rms_error_percent_after_1s};
  }
  judging.work_budget = kServoWorkBudget;
  judging.keep_forces = false;
  std::vector<double> least_cycle_ns;
  judging.least_cycle_ns = &least_cycle_ns;
  Verdict verdict;
  for (int i = 0; i < runs; ++i) {
    const std::unique_ptr<ForceMethod> made =
        make(method, object.known.mesh, object.scene.patch_radius_m);
    verdict = judge(*made, trace, judging);
  }
  return {verdict.cycle_ns, verdict.cycle_ns_p99, verdict.cycle_ns_p999,
          verdict.rms_error_percent_after_1s};
}

ChartRow judge_row(Object& object, const Trajectory& trajectory, const Trace& trace,
                   JudgeOptions judging, const ChartMethod& method, const ChartOptions& options) {
  const simulator::MadeRival made = make(method, object.known, options.cancel);
  judging.keep_forces = trajectory.is_closed_loop() || trajectory.is_exploration() ||
                        !object.scene.extras.walls.empty();
  ChartRow row;
  row.scene = object.scene.name;
  row.trajectory = trajectory.name();
  row.method = method.text;
  row.precompute_s = made.precompute_s;
  row.verdict = judge(*made.method, trace, judging);
  row.split =
      split_cost(object, trace, judging, method, row.verdict, options.quick ? 1 : kSplitRuns);
  if (!object.scene.extras.walls.empty()) {
    row.after_touch_percent =
        rms_error_percent_from(wall_known_s(object.scene, trace), trace, row.verdict);
  }
  if (trajectory.is_closed_loop()) {
    const double stored_J = 0.5 * object.facts.stiffness_N_per_m * Trajectory::kLoopRadius_m *
                            Trajectory::kLoopRadius_m;
    double sum_J = 0.0;
    double worst_J = 0.0;
    const std::vector<double> works_J = closed_loop_work_J(
        trace.servo, row.verdict.forces_W, Trajectory::kFirstLoop_s, Trajectory::kLoopPeriod_s);
    for (const double work_J : works_J) {
      sum_J += work_J;
      worst_J = std::abs(work_J) > std::abs(worst_J) ? work_J : worst_J;
    }
    row.loop_work_percent = 100.0 * sum_J / static_cast<double>(works_J.size()) / stored_J;
    row.worst_loop_work_percent = 100.0 * worst_J / stored_J;
  }
  if (trajectory.is_exploration()) {
    row.returns =
        return_errors(trace.servo, trajectory.contacts().front().point_W, row.verdict.forces_W);
  }
  row.verdict.forces_W.clear();
  row.verdict.forces_W.shrink_to_fit();
  return row;
}

ChartRow judge_visits_row(const Object& object, const NetworkCondition& condition,
                          const ChartMethod& method, std::uint64_t seed) {
  const std::unique_ptr<ForceMethod> made =
      make(method, object.known.mesh, object.scene.patch_radius_m);
  VisitsOptions visiting;
  visiting.servo_rate_Hz = kChartServoRate_Hz;
  visiting.simulator_rate_Hz = condition.simulator_rate_Hz;
  visiting.requests_per_s = condition.requests_per_s;
  visiting.stiffness = condition.stiffness;
  visiting.seed = seed;
  VisitsVerdict judged = judge_visits(*made, object.table, visiting);
  ChartRow row;
  row.scene = object.scene.name;
  row.trajectory = kVisits;
  row.method = method.text;
  row.verdict = std::move(judged.verdict);
  row.visits = judged.errors;
  return row;
}

// Time per row, estimated from the finished rows.
class TimeLeft {
 public:
  void add(const std::string& scene, const std::string& method, double time_s) {
    for (const std::string& key : {scene + "/" + method, method, std::string()}) {
      Mean& mean = means_[key];
      mean.sum_s += time_s;
      mean.count += 1.0;
    }
  }
  double of(const std::string& scene, const std::string& method) const {
    for (const std::string& key : {scene + "/" + method, method, std::string()}) {
      const auto found = means_.find(key);
      if (found != means_.end()) {
        return found->second.sum_s / found->second.count;
      }
    }
    return 0.0;
  }

 private:
  struct Mean {
    double sum_s = 0.0;
    double count = 0.0;
  };
  std::map<std::string, Mean> means_;
};

struct Job {
  std::size_t scene;
  std::size_t trajectory;
  const NetworkCondition* condition;
  const ChartMethod* method;
  std::string key;
};

// Makes the rows of a chart one after the other, so that their costs do not disturb each other.
class Judging {
 public:
  Judging(const ChartOptions& options, const ChartPlan& plan)
      : options_(options), plan_(plan), store_(options.out, options.program) {
    for (const std::string& scene : plan_.scenes) {
      check_stop(options_);
      objects_.push_back(make_object(options_, scene));
    }
    for (const std::string& name : plan_.trajectories) {
      trajectories_.emplace_back();
      if (name != kVisits) {
        trajectories_.back().emplace(name, options_.seed);
      }
    }
  }

  // Runs every job of the selection and adds its row to `chart`.
  void judge(Chart& chart) {
    const std::vector<Job> jobs = selected_jobs();
    for (const Job& job : jobs) {
      pending_[{objects_[job.scene].scene.name, job.method->text}] +=
          store_.find(job.key) == nullptr ? 1.0 : 0.0;
    }
    for (std::size_t j = 0; j < jobs.size(); ++j) {
      time_direct(jobs[j]);
      if (const ChartRow* kept = store_.find(jobs[j].key)) {
        chart.rows.push_back(*kept);
        ++chart.rows_kept;
        continue;
      }
      check_stop(options_);
      if (std::optional<ChartRow> row = try_to_judge(jobs[j], chart.not_judged)) {
        store_.keep(*row);
        chart.rows.push_back(std::move(*row));
      }
      report_progress(static_cast<double>(j + 1) / static_cast<double>(jobs.size()));
    }
    if (chart.rows.empty() && !chart.not_judged.empty()) {
      throw ChartError("none of the " + std::to_string(chart.not_judged.size()) +
                       " rows could be judged; the first: " + chart.not_judged.front().reason);
    }
    for (const Object& object : objects_) {
      chart.tables.push_back(object.facts);
    }
  }

 private:
  std::vector<Job> selected_jobs() const {
    std::vector<Job> jobs;
    for (std::size_t scene = 0; scene < objects_.size(); ++scene) {
      for (std::size_t trajectory = 0; trajectory < trajectories_.size(); ++trajectory) {
        for (const std::string& name : plan_.conditions) {
          append_jobs(scene, trajectory, network_condition(name), jobs);
        }
      }
    }
    if (jobs.empty() && options_.shard.whole()) {
      throw ChartError(
          "nothing to evaluate: no condition of the selection supplies what its methods need; add "
          "the condition stiffness for methods that need dF/dP, or requests120 for methods that "
          "make requests");
    }
    return jobs;
  }

  void append_jobs(std::size_t scene, std::size_t trajectory, const NetworkCondition& condition,
                   std::vector<Job>& jobs) const {
    const Object& object = objects_[scene];
    const std::string& motion = plan_.trajectories[trajectory];
    const Trajectory* const path =
        trajectories_[trajectory] ? &*trajectories_[trajectory] : nullptr;
    for (const ChartMethod& method : plan_.methods) {
      if (plan_.pieces.contains({object.scene.name, motion, condition.name}) &&
          applies(method, object.scene, condition, path)) {
        jobs.push_back({scene, trajectory, &condition, &method,
                        row_key(options_, object.scene.name, object.facts.key, motion, condition,
                                method.text)});
      }
    }
  }

  // Cost of a cycle of `direct`, measured once per object.
  void time_direct(const Job& job) {
    Object& object = objects_[job.scene];
    if (job.method->direct && !job.method->rival && object.facts.direct_cycle_us == 0.0) {
      simulator::DirectMethod direct(object.known.mesh, {.grab_on_own_thread = false});
      object.facts.direct_cycle_us = 1e6 * direct.measured_cycle_s(1.0 / kChartServoRate_Hz);
    }
  }

  // The trace of a job, kept for the following jobs that share it; not for visits.
  void make_trace_of(const Job& job) {
    const std::optional<Trajectory>& trajectory = trajectories_[job.trajectory];
    if (!trajectory ||
        (traced_ && traced_->scene == job.scene && traced_->trajectory == job.trajectory &&
         traced_->condition == job.condition)) {
      return;
    }
    const Object& object = objects_[job.scene];
    trace_.reset();
    limit_ = {};
    trace_problem_.clear();
    traced_ = job;
    try {
      trace_ = make_trace(*trajectory, object.table, *job.condition, kChartServoRate_Hz,
                          options_.seed, object.scene.extras);
      limit_ = blind_limit(
          TouchedObject(*trajectory, object.table, object.scene.extras, kChartServoRate_Hz),
          *trace_);
    } catch (const ChartError& error) {
      trace_problem_ = error.what();
    }
  }

  // Nothing, and a line in `not_judged`, for a row that can't be judged. Other errors end the
  // chart.
  std::optional<ChartRow> try_to_judge(const Job& job, std::vector<NotJudged>& not_judged) {
    std::string reason;
    try {
      return judge(job);
    } catch (const ChartError& error) {
      reason = error.what();
    } catch (const simulator::Error& error) {
      reason = error.what();
    } catch (const std::invalid_argument& error) {
      reason = error.what();
    }
    const std::string& scene = objects_[job.scene].scene.name;
    pending_[{scene, job.method->text}] -= 1.0;
    not_judged.push_back(
        {scene, plan_.trajectories[job.trajectory], job.condition->name, job.method->text, reason});
    say(options_, "not judged: " + job.method->text + " on " + scene + ", " +
                      not_judged.back().trajectory + ", " + not_judged.back().condition + ": " +
                      reason);
    return std::nullopt;
  }

  ChartRow judge(const Job& job) {
    make_trace_of(job);
    if (trajectories_[job.trajectory] && !trace_) {
      throw ChartError(trace_problem_);  // for every method alike
    }
    Object& object = objects_[job.scene];
    const std::optional<Trajectory>& trajectory = trajectories_[job.trajectory];
    const auto start = std::chrono::steady_clock::now();
    ChartRow row =
        trajectory
            ? judge_row(object, *trajectory, *trace_,
                        judge_options(*trajectory, object.table, *job.condition, kChartServoRate_Hz,
                                      options_.seed, object.scene.extras),
                        *job.method, options_)
            : judge_visits_row(object, *job.condition, *job.method, options_.seed);
    row.key = job.key;
    row.condition = job.condition->name;
    if (trajectory) {
      row.blind_limit = limit_;
    }
    times_.add(row.scene, row.method, seconds_since(start) - newly_computed_s(row));
    pending_[{row.scene, row.method}] -= 1.0;
    return row;
  }

  // [s] What the first row of a rival took for its tables, which the others do not.
  double newly_computed_s(const ChartRow& row) {
    constexpr double kWorthALine_s = 1.0;
    if (!std::isfinite(row.precompute_s) || !computed_.insert({row.scene, row.method}).second) {
      return 0.0;
    }
    if (row.precompute_s > kWorthALine_s) {
      say(options_, row.method + " on " + row.scene + ": tables computed beforehand in " +
                        rounded(row.precompute_s, "%.0f s"));
    }
    return row.precompute_s;
  }

  void report_progress(double done) const {
    if (!options_.progress) {
      return;
    }
    double remaining_s = 0.0;
    for (const auto& [what, count] : pending_) {
      remaining_s += count * times_.of(what.first, what.second);
    }
    options_.progress("judging", done, remaining_s);
  }

  const ChartOptions& options_;
  const ChartPlan& plan_;
  RowStore store_;
  std::vector<Object> objects_;
  std::vector<std::optional<Trajectory>> trajectories_;  // empty: visits
  TimeLeft times_;
  std::map<std::pair<std::string, std::string>, double> pending_;  // jobs by scene and method
  std::set<std::pair<std::string, std::string>> computed_;         // rivals' tables, the same
  std::optional<Trace> trace_;
  BlindLimit limit_;           // of trace_
  std::string trace_problem_;  // why there is no trace
  std::optional<Job> traced_;  // the job of trace_
};

}  // namespace

Chart make_chart(const ChartOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  const ChartPlan plan = plan_of(options);
  Chart chart;
  chart.not_run = plan.not_run;
  for (const NotRun& each : plan.not_run) {
    say(options, "not run: " + each.method + ": " + each.reason);
  }
  Judging(options, plan).judge(chart);
  chart.bare_trilinear_read_ns = bare_trilinear_read_ns();
  chart.numbers = numbers_of(chart, options.default_method);
  chart.elapsed_s = seconds_since(start);
  return chart;
}

ChartTrace trace_of(const ChartOptions& options, const std::string& scene,
                    const std::string& trajectory_name, const std::string& condition_name,
                    const std::vector<std::string>& methods) {
  const NetworkCondition& condition = network_condition(condition_name);
  const Trajectory trajectory(trajectory_name, options.seed);
  std::vector<ChartMethod> parsed;
  for (const std::string& text : methods) {
    parsed.push_back(method_of(text));
  }
  const ChartScene& chosen = chart_scene(scene);
  const SceneExtras& extras = chosen.extras;
  KnownObject known = known_object(chosen);
  const BuiltTable built =
      build_table(known.mesh, table_options(options, chosen, "force table of " + scene));
  ChartTrace result;
  result.trace =
      make_trace(trajectory, built.table, condition, kChartServoRate_Hz, options.seed, extras);
  for (const ChartMethod& method : parsed) {
    check_stop(options);
    JudgeOptions judging =
        judge_options(trajectory, built.table, condition, kChartServoRate_Hz, options.seed, extras);
    judging.keep_forces = true;
    result.methods.push_back(method.text);
    result.forces_W.push_back(
        judge(*make(method, known, options.cancel).method, result.trace, judging).forces_W);
  }
  return result;
}

std::vector<double> closed_loop_work_J(const std::vector<ServoInstant>& servo,
                                       const std::vector<Vector3d>& forces_W, double first_s,
                                       double period_s) {
  std::vector<double> works_J;
  if (servo.size() < 3 || forces_W.size() != servo.size()) {
    return works_J;
  }
  const double cycle_s =
      (servo.back().time_s - servo.front().time_s) / static_cast<double>(servo.size() - 1);
  const auto turn = static_cast<std::size_t>(std::lround(period_s / cycle_s));
  auto begin = static_cast<std::size_t>(
      std::max(1L, std::lround((first_s - servo.front().time_s) / cycle_s)));
  for (; begin + turn < servo.size(); begin += turn) {
    double work_J = 0.0;
    for (std::size_t i = begin; i < begin + turn; ++i) {
      work_J += 0.5 * forces_W[i].dot(servo[i + 1].position_W - servo[i - 1].position_W);
    }
    works_J.push_back(work_J);
  }
  return works_J;
}

std::vector<bool> pareto_front(const std::vector<double>& x, const std::vector<double>& y) {
  std::vector<bool> on_front(x.size(), false);
  for (std::size_t i = 0; i < x.size(); ++i) {
    on_front[i] = std::isfinite(x[i]) && std::isfinite(y[i]);
    for (std::size_t j = 0; j < x.size() && on_front[i]; ++j) {
      on_front[i] = !(x[j] <= x[i] && y[j] <= y[i] && (x[j] < x[i] || y[j] < y[i]));
    }
  }
  return on_front;
}

}  // namespace forcegrid::evaluation
