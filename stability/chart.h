// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/charts/shard.h"
#include "evaluation/objects/force_table.h"
#include "stability/chart_cases.h"
#include "stability/fault_sweep.h"
#include "stability/search.h"

namespace forcegrid::stability {

struct StabilityChartOptions {
  std::filesystem::path out;         ///< folder for rows.jsonl, created if missing
  std::filesystem::path cache;       ///< folder for force tables
  std::vector<std::string> methods;  ///< MethodVariant texts; empty: chart_methods()
  std::vector<std::string> parts;    ///< of chart_parts(); empty: all of them
  std::vector<std::string> hands;    ///< empty: all of them
  bool quick = false;                ///< the small block and fewer cells, within five minutes
  /// Just these cells, instead of the parts and without the fault sweep; empty: the parts.
  std::vector<StabilityCase> cells;
  evaluation::Shard shard;  ///< only these cells, without the fault sweep, if it is not the whole
  unsigned jobs = 0;        ///< threads; 0: one per processor
  std::uint64_t seed = 1;
  int swept_runs = 2000;       ///< runs of the fault sweep on the first of kSweptDevices
  std::string default_method;  ///< compared with the goals
  /// Identifies the measuring program: rows of another program are not reused.
  std::string program;
  std::function<void(const std::string&)> say;  ///< receives facts and warnings, one line each
  /// Receives the current activity, the fraction done in [0, 1] and the time left [s]. Called from
  /// one thread at a time.
  std::function<void(const std::string& what, double done, double remaining_s)> progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: Stopped is thrown soon
};

/// A cell and its results.
struct StabilityRow {
  StabilityCase cell;
  StiffnessLimit limit;  ///< where cell.find_limit
  LoopResult run;        ///< at cell.stiffness_N_per_m
};

/// A cell that has no results.
struct NotJudgedCell {
  StabilityCase cell;
  std::string reason;
};

/// A goal and the measured value; NaN if the selection does not contain it.
struct StabilityNumber {
  std::string name;
  double goal = 0.0;
  bool at_least = false;  ///< the goal is a lower bound
  double measured = std::numeric_limits<double>::quiet_NaN();
  std::string unit;
  std::string worst;  ///< row of the measured value
  bool known() const noexcept { return measured == measured; }
  bool met() const noexcept { return at_least ? measured >= goal : measured <= goal; }
  double ratio() const noexcept { return measured / goal; }
};

struct StabilityChart {
  std::string scene;  ///< evaluation::ChartScene whose table was used
  double table_stiffness_N_per_m = 0.0;
  std::vector<StabilityRow> rows;
  std::vector<NotJudgedCell> not_judged;
  std::vector<SweptRun> sweep;   ///< ordered by device; empty: not in the selection
  std::vector<SweepLine> swept;  ///< sweep_table() of them
  std::vector<StabilityNumber> numbers;
  std::size_t rows_kept = 0;  ///< reused from an earlier call
  double elapsed_s = 0.0;
};

/// A device of the fault sweep, and its number of runs as a fraction of
/// StabilityChartOptions::swept_runs.
struct SweptDevice {
  const char* profile;
  double part;
};
inline constexpr SweptDevice kSweptDevices[] = {
    {"woodenhaptics_v2015", 1.0}, {"phantom_desktop", 0.25}, {"falcon", 0.25}};

/// Runs every cell of the selection on all cores, and the fault sweep of kSweptDevices with the
/// default method, `hold` and `rls`. Finished rows are appended to `out`/rows.jsonl, and the next
/// call with the same program reuses them; it repeats the fault sweep. A cell that can't be judged
/// is named with the reason, and the rest goes on.
/// @throws evaluation::ChartError, also where no cell can be judged, std::invalid_argument for a
/// method that can't be made,
///         evaluation::Stopped, and as evaluation::build_table().
StabilityChart make_stability_chart(const StabilityChartOptions& options);

/// Runs one cell. `table` belongs to the held object.
/// @throws evaluation::ChartError or std::invalid_argument for a cell that can't be judged.
StabilityRow run_case(const StabilityCase& cell, const evaluation::ForceTable& table,
                      std::uint64_t seed);

/// run_case(); nothing for a cell that can't be judged, which is appended to `not_judged`.
/// Threads: any, with a list each.
std::optional<StabilityRow> try_case(const StabilityCase& cell, const evaluation::ForceTable& table,
                                     std::uint64_t seed, std::vector<NotJudgedCell>& not_judged);

/// [N/m] Largest stable stiffness of a cell on the linear device, from the eigenvalues.
double eigenvalue_limit_of(const StabilityCase& cell);

}  // namespace forcegrid::stability
