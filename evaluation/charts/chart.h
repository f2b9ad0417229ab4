// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "evaluation/charts/shard.h"
#include "evaluation/judge/judge.h"
#include "evaluation/motions/exploration.h"
#include "evaluation/motions/variation.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/scenarios/blind_limit.h"
#include "evaluation/traces/trace.h"

namespace forcegrid::evaluation {

/// Servo rate [Hz] of every trace of the chart.
inline constexpr double kChartServoRate_Hz = 500.0;

struct ChartOptions {
  std::filesystem::path out;    ///< folder for rows.jsonl, created if missing
  std::filesystem::path cache;  ///< folder for force tables
  /// Names; empty: all of them, or with `quick` a selection that takes less than a minute.
  std::vector<std::string> scenes;
  std::vector<std::string> trajectories;
  std::vector<std::string> conditions;
  std::vector<std::string> methods;  ///< MethodVariant texts, "direct", or a simulator::Rival
  bool quick = false;
  Shard shard;                               ///< only these rows, if it is not the whole
  TableLattice lattice;                      ///< of the force tables
  unsigned jobs = 0;                         ///< threads that make tables; 0: one per processor
  std::uint64_t seed = 1;                    ///< of trajectories, noise and network
  std::string default_method = "forcegrid";  ///< compared with the goals
  /// Identifies the measuring program: rows of another program are not reused.
  std::string program;
  std::function<void(const std::string&)> say;  ///< receives facts and warnings, one line each
  /// Receives the current activity, the fraction done in [0, 1] of all rows or of one table, and
  /// the time left [s].
  std::function<void(const std::string& what, double done, double remaining_s)> progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: Stopped is thrown soon
};

/// What a cycle costs, and the error, where work is split over cycles as a servo loop splits it
/// (kServoWorkBudget), while Verdict is of a method that does all work in the sample's own cycle.
struct SplitCost {
  double cycle_ns_mean = std::numeric_limits<double>::quiet_NaN();
  double cycle_ns_p99 = std::numeric_limits<double>::quiet_NaN();
  double cycle_ns_p999 = std::numeric_limits<double>::quiet_NaN();
  double rms_error_percent_after_1s = std::numeric_limits<double>::quiet_NaN();
};

/// One method on one object, motion and network.
struct ChartRow {
  std::string key;  ///< hash of everything that the row's values depend on
  std::string scene;
  std::string trajectory;
  std::string condition;
  std::string method;
  Verdict verdict;  ///< without forces
  /// Work on the hand per turn of `circle`, in % of the stored energy 1/2 K r^2 (K: the object's
  /// normal stiffness at rest, r = 8 mm): the mean, and the turn with the largest magnitude. NaN
  /// for other trajectories.
  double loop_work_percent = std::numeric_limits<double>::quiet_NaN();
  double worst_loop_work_percent = std::numeric_limits<double>::quiet_NaN();
  ReturnErrors returns;  ///< NaN for trajectories other than `exploration`
  /// RMS error from 0.2 s after the first touch of a wall on, in % of the whole run's RMS force;
  /// NaN if the scene has no wall or the tool does not touch it.
  double after_touch_percent = std::numeric_limits<double>::quiet_NaN();
  /// Errors that no method can be below; NaN for visits.
  BlindLimit blind_limit;
  VisitErrors visits;  ///< NaN for motions other than kVisits
  SplitCost split;     ///< NaN for visits
  /// [s] From the mesh to a method that can answer, for a method that knows the object's model and
  /// computes tables of it beforehand; once per object and call. NaN for others.
  double precompute_s = std::numeric_limits<double>::quiet_NaN();
};

/// An object of the chart and the accuracy of its force table.
struct ChartTable {
  std::string scene;
  std::string title;
  std::string key;
  bool from_cache = false;
  double solved_s = 0.0;           ///< time of the solves in this call
  double stiffness_N_per_m = 0.0;  ///< K: -dFz/dz at rest
  TableDifference along_motion;    ///< at 200 positions of `random`
  TableDifference at_random;       ///< at 60 random positions in the whole table
  double direct_cycle_us = 0.0;    ///< DirectMethod::measured_cycle_s(); 0: not measured
};

/// A row that could not be judged, and the reason. The other rows of the chart are not affected.
struct NotJudged {
  std::string scene;
  std::string trajectory;
  std::string condition;
  std::string method;
  std::string reason;
};

/// A default method that this program can't make, and the reason.
struct NotRun {
  std::string method;
  std::string reason;
};

/// A goal for the default method and the measured value; NaN if the selection does not contain it.
struct ChartNumber {
  std::string name;
  std::string scene;
  double goal = 0.0;
  double measured = std::numeric_limits<double>::quiet_NaN();
  std::string unit;
  std::string worst;  ///< row of the measured value
  bool met() const noexcept { return measured <= goal; }
  bool known() const noexcept { return measured == measured; }
  double ratio() const noexcept { return measured / goal; }  ///< above 1: missed
};

/// A method in the picture of a scene: error against cost per servo cycle.
struct ChartPoint {
  std::string method;
  std::string condition;  ///< ideal, or the condition that the method needs: stiffness, requests120
  double error_percent = 0.0;  ///< geometric mean over the static trajectories, RMS after 1 s
  double cycle_ns = 0.0;       ///< mean over them, samples included
  bool on_front = false;       ///< not dominated: no other method is both faster and more accurate
};

struct Chart {
  std::vector<ChartTable> tables;
  std::vector<ChartRow> rows;
  std::vector<NotJudged> not_judged;
  std::vector<NotRun> not_run;
  std::vector<ChartNumber> numbers;
  double bare_trilinear_read_ns = std::numeric_limits<double>::quiet_NaN();  ///< on this machine
  std::size_t rows_kept = 0;  ///< reused from an earlier call
  double elapsed_s = 0.0;
};

/// The motion of judge_visits(); its rows have no errors of the other kinds.
inline constexpr char kVisits[] = "visits";

/// Returns the methods of a chart if none are selected.
std::vector<std::string> default_chart_methods();

/// Returns trajectory_names() and kVisits.
std::vector<std::string> chart_motions();

/// Evaluates every method of the selection on every scene, trajectory and condition. Finished rows
/// are appended to `out`/rows.jsonl, and the next call with the same program and selection reuses
/// them. Methods run one at a time, so that their costs do not disturb each other. A method that
/// needs stiffness or requests runs only under conditions that supply them. `direct` and the rivals
/// run only under `ideal`, and only on objects that are the same everywhere. A row that can't be
/// judged, for example because its motion leaves the force table, is listed with the reason, and
/// the rest goes on; the next call tries it again. A shard makes the rows of its pieces, and none
/// is no mistake.
/// @throws ChartError for an unknown name, std::invalid_argument for a method that can't be made,
///         Stopped, and as build_table().
Chart make_chart(const ChartOptions& options);

/// The recording that a row is evaluated on, e.g. for a picture of its forces.
struct ChartTrace {
  Trace trace;
  std::vector<std::string> methods;
  std::vector<std::vector<Eigen::Vector3d>> forces_W;  ///< one per method and servo instant
};
ChartTrace trace_of(const ChartOptions& options, const std::string& scene,
                    const std::string& trajectory, const std::string& condition,
                    const std::vector<std::string>& methods);

/// [J] Work of a force on the hand in each full turn of the period `period_s` from `first_s` on:
/// the closed integral of F.dP by the trapezium rule over the servo instants.
std::vector<double> closed_loop_work_J(const std::vector<ServoInstant>& servo,
                                       const std::vector<Eigen::Vector3d>& forces_W, double first_s,
                                       double period_s);

/// Marks the points that no other point dominates. A point dominates another if neither its x nor
/// its y is larger and one of them is smaller. Points that are not finite are never on the front.
std::vector<bool> pareto_front(const std::vector<double>& x, const std::vector<double>& y);

}  // namespace forcegrid::evaluation
