#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "evaluation/force_table.h"
#include "stability/chart_cases.h"
#include "stability/fault_sweep.h"
#include "stability/search.h"

namespace forcegrid::stability {

struct StabilityChartOptions {
  std::filesystem::path out;         ///< folder for rows.jsonl, made if it isn't there
  std::filesystem::path cache;       ///< folder for force tables
  std::vector<std::string> methods;  ///< MethodVariant texts; empty: chart_methods()
  std::vector<std::string> parts;    ///< of chart_parts(); empty: all of them
  std::vector<std::string> hands;    ///< empty: all of them
  bool quick = false;                ///< the small block and fewer cells, within five minutes
  unsigned jobs = 0;                 ///< threads; 0: one a processor
  std::uint64_t seed = 1;
  int swept_runs = 2000;       ///< of the fault sweep on the first of kSweptDevices
  std::string default_method;  ///< held against the goals
  /// Identifies the program that measures: rows of another program aren't taken over.
  std::string program;
  std::function<void(const std::string&)> say;  ///< facts and warnings, a line each
  /// What is being done, fraction done in [0, 1], time left [s]. Called from one thread at a time.
  std::function<void(const std::string& what, double done, double remaining_s)> progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: Stopped is thrown soon
};

/// A cell and what was found in it.
struct StabilityRow {
  StabilityCase cell;
  StiffnessLimit limit;  ///< where cell.find_limit
  LoopResult run;        ///< at cell.stiffness_N_per_m
};

/// A goal beside what was measured; NaN where the selection doesn't have it.
struct StabilityNumber {
  std::string name;
  double goal = 0.0;
  bool at_least = false;  ///< the goal is a lower bound
  double measured = std::numeric_limits<double>::quiet_NaN();
  std::string unit;
  std::string worst;  ///< where the measured value comes from
  bool known() const noexcept { return measured == measured; }
  bool met() const noexcept { return at_least ? measured >= goal : measured <= goal; }
};

struct StabilityChart {
  std::string scene;  ///< evaluation::ChartScene whose table was used
  double table_stiffness_N_per_m = 0.0;
  std::vector<StabilityRow> rows;
  std::vector<SweptRun> sweep;   ///< of one device after the other; empty: not in the selection
  std::vector<SweepLine> swept;  ///< sweep_table() of them
  std::vector<StabilityNumber> numbers;
  std::size_t rows_kept = 0;  ///< taken over from an earlier call
  double elapsed_s = 0.0;
};

/// A device of the fault sweep, and how many runs it has of StabilityChartOptions::swept_runs.
struct SweptDevice {
  const char* profile;
  double part;
};
inline constexpr SweptDevice kSweptDevices[] = {
    {"woodenhaptics_v2015", 1.0}, {"phantom_desktop", 0.25}, {"falcon", 0.25}};

/// Runs every cell of the selection on all cores, and the fault sweep of kSweptDevices with the
/// default method, `hold` and `rls`, which a call that goes on makes anew. Rows are appended to
/// `out`/rows.jsonl as they are finished and taken over by the next call with the same program.
/// @throws evaluation::ChartError, std::invalid_argument for a method that can't be made,
/// evaluation::Stopped, and what evaluation::build_table throws.
StabilityChart make_stability_chart(const StabilityChartOptions& options);

/// Runs one cell. `table` is that of the held object.
StabilityRow run_case(const StabilityCase& cell, const evaluation::ForceTable& table,
                      std::uint64_t seed);

/// [N/m] Eigenvalue limit of a cell on the linear device.
double eigenvalue_limit_of(const StabilityCase& cell);

}  // namespace forcegrid::stability
