#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "evaluation/exploration.h"
#include "evaluation/force_table.h"
#include "evaluation/judge.h"
#include "evaluation/trace.h"
#include "evaluation/variation.h"

namespace forcegrid::evaluation {

/// Servo rate [Hz] of every trace of the chart.
inline constexpr double kChartServoRate_Hz = 500.0;

struct ChartOptions {
  std::filesystem::path out;    ///< folder for rows.jsonl, made if it isn't there
  std::filesystem::path cache;  ///< folder for force tables
  /// Names; empty: all of them, or with `quick` a selection that takes less than a minute.
  std::vector<std::string> scenes;
  std::vector<std::string> trajectories;
  std::vector<std::string> conditions;
  std::vector<std::string> methods;  ///< MethodVariant texts, or "direct"
  bool quick = false;
  unsigned jobs = 0;                         ///< threads that make tables; 0: one a processor
  std::uint64_t seed = 1;                    ///< of trajectories, noise and network
  std::string default_method = "forcegrid";  ///< held against the goals
  /// Identifies the program that measures: rows of another program aren't taken over.
  std::string program;
  std::function<void(const std::string&)> say;  ///< facts and warnings, a line each
  /// What is being done, fraction done in [0, 1] of all rows or of one table, time left [s].
  std::function<void(const std::string& what, double done, double remaining_s)> progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: Stopped is thrown soon
};

/// One method on one object, motion and network.
struct ChartRow {
  std::string key;  ///< hash of everything that the figures depend on
  std::string scene;
  std::string trajectory;
  std::string condition;
  std::string method;
  Verdict verdict;  ///< without forces
  /// Work on the hand in a turn of `circle`, in % of the stored energy 1/2 K r^2 (K: the object's
  /// normal stiffness at rest, r = 8 mm): the mean, and the turn with the largest amount. NaN for
  /// other trajectories.
  double loop_work_percent = std::numeric_limits<double>::quiet_NaN();
  double worst_loop_work_percent = std::numeric_limits<double>::quiet_NaN();
  ReturnErrors returns;  ///< NaN for trajectories other than `exploration`
  /// RMS error from 0.2 s after the first touch of a wall on, in % of the whole run's RMS force;
  /// NaN where there is no wall, or it is not touched.
  double after_touch_percent = std::numeric_limits<double>::quiet_NaN();
  VisitErrors visits;  ///< NaN for motions other than kVisits
};

/// An object of the chart and how well its table stands for it.
struct ChartTable {
  std::string scene;
  std::string title;
  std::string key;
  bool from_cache = false;
  double solved_s = 0.0;           ///< time that the solves of this call took
  double stiffness_N_per_m = 0.0;  ///< K: -dFz/dz at rest
  TableDifference along_motion;    ///< at 200 positions of `random`
  TableDifference at_random;       ///< at 60 random positions of the whole table
  double direct_cycle_us = 0.0;    ///< DirectMethod::measured_cycle_s(); 0: not asked for
};

/// A default variant that this program can't make, and why.
struct NotRun {
  std::string method;
  std::string reason;
};

/// A goal for the default method beside what was measured; NaN where the selection doesn't have it.
struct ChartNumber {
  std::string name;
  std::string scene;
  double goal = 0.0;
  double measured = std::numeric_limits<double>::quiet_NaN();
  std::string unit;
  std::string worst;  ///< where the measured value comes from
  bool met() const noexcept { return measured <= goal; }
  bool known() const noexcept { return measured == measured; }
};

/// A method in the picture of a scene: error against cost per servo cycle.
struct ChartPoint {
  std::string method;
  std::string condition;       ///< ideal, or what the method needs: stiffness, requests120
  double error_percent = 0.0;  ///< geometric mean over the static trajectories, RMS after 1 s
  double cycle_ns = 0.0;       ///< mean over them, samples included
  bool on_front = false;       ///< no other method is both quicker and more accurate
};

struct Chart {
  std::vector<ChartTable> tables;
  std::vector<ChartRow> rows;
  std::vector<NotRun> not_run;
  std::vector<ChartNumber> numbers;
  double bare_trilinear_read_ns = std::numeric_limits<double>::quiet_NaN();  ///< on this machine
  std::size_t rows_kept = 0;  ///< taken over from an earlier call
  double elapsed_s = 0.0;
};

/// The motion of judge_visits(); its rows have no errors of the other kinds.
inline constexpr char kVisits[] = "visits";

/// What a chart takes when nothing is selected.
std::vector<std::string> default_chart_methods();

/// trajectory_names(), and kVisits.
std::vector<std::string> chart_motions();

/// Judges every method of the selection on every scene, trajectory and condition. Rows are appended
/// to `out`/rows.jsonl as they are finished and taken over by the next call with the same program
/// and selection. Methods are judged one at a time, so that their costs are their own; a method
/// that needs stiffness or requests is judged where the condition has them; `direct` on `ideal`
/// only, where the object is one and the same everywhere.
/// @throws ChartError for an unknown name, std::invalid_argument for a method that can't be made,
///         Stopped, and what build_table throws.
Chart make_chart(const ChartOptions& options);

/// The recording that a row is judged on, e.g. for a picture of its forces.
struct ChartTrace {
  Trace trace;
  std::vector<std::string> methods;
  std::vector<std::vector<Eigen::Vector3d>> forces_W;  ///< one a method and servo instant
};
ChartTrace trace_of(const ChartOptions& options, const std::string& scene,
                    const std::string& trajectory, const std::string& condition,
                    const std::vector<std::string>& methods);

/// Work [J] that a force does on the hand in each full turn from `first_s` on, period `period_s`:
/// the closed integral of F.dP by the trapezium rule on the servo's instants.
std::vector<double> closed_loop_work_J(const std::vector<ServoInstant>& servo,
                                       const std::vector<Eigen::Vector3d>& forces_W, double first_s,
                                       double period_s);

/// Which of the points no other dominates: none has both a smaller or equal x and y, one of them
/// smaller. Points that aren't finite are never on the front.
std::vector<bool> pareto_front(const std::vector<double>& x, const std::vector<double>& y);

}  // namespace forcegrid::evaluation
