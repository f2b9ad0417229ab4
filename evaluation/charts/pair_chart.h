// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "evaluation/judge/pair_judge.h"
#include "evaluation/scenarios/pair_reference.h"

namespace forcegrid::evaluation {

/// What `forcegrid chart two-tools` measures.
struct PairChartOptions {
  std::filesystem::path out;  ///< folder for tables and traces; made if it isn't there
  std::filesystem::path cache;
  std::vector<std::string> scenes{"small", "block"};
  std::vector<std::string> pairs;    ///< of pair_motion_names(); empty: all
  std::vector<std::string> methods;  ///< as parse_pair_variant() takes them; empty: the chart's
  std::string goals_for = "auto-6d";
  double seconds = 10.0;
  double delay_s = 0.0;    ///< see PairTraceOptions
  double noise_N = 0.0;    ///< likewise
  bool stiffness = false;  ///< likewise
  std::uint64_t seed = 1;
  unsigned jobs = 0;  ///< threads that solve traces; 0: one per processor
  const std::atomic<bool>* cancel = nullptr;
  std::function<void(const std::string&)> say;
  /// Called with what is done, the fraction of it, and the time left [s].
  std::function<void(const std::string& what, double done, double remaining_s)> progress;
};

/// A method on a trace.
struct PairChartRow {
  std::string scene;
  std::string pair;
  std::string method;
  bool coupled = false;
  PairVerdict verdict;
  double trilinear_read_ns = 0.0;  ///< bare, measured just before the row

  double query_reads() const noexcept { return verdict.query_ns_median / trilinear_read_ns; }
};

/// A goal of the chart. All are upper bounds.
struct PairChartNumber {
  std::string name;
  double measured = 0.0;  ///< NaN: not in the selection
  double goal = 0.0;
  std::string unit;
  std::string worst;  ///< what it is of: the pair of motions, or the scene

  bool known() const noexcept { return measured == measured; }
  bool met() const noexcept { return measured <= goal; }
};

struct PairChart {
  std::vector<PairChartRow> rows;
  std::vector<PairChartNumber> numbers;
  std::size_t unconverged = 0;     ///< instants, of all traces made in this call
  std::size_t branch_changes = 0;  ///< as well
};

/// Methods that the chart shows without being asked.
const std::vector<std::string>& default_pair_chart_methods();

/// Solves the traces or takes them from the cache, writes each to out/traces/SCENE-PAIR.csv.gz, and
/// judges every method on each, one after the other on this thread.
/// @throws ChartError for an unknown scene, pair or method; Stopped; FileError, TraceError.
PairChart make_pair_chart(const PairChartOptions& options);

/// The geometric mean over the pairs of motions of the error of both tools together after 1 s [%];
/// NaN without rows.
double geometric_mean_percent(const PairChart& chart, const std::string& scene,
                              const std::string& method);

/// Writes two_tools.csv (a row for each method and trace), two_tools.json and two_tools.md.
/// @returns the files. @throws FileError.
std::vector<std::filesystem::path> write_pair_chart(const PairChart& chart,
                                                    const PairChartOptions& options);

}  // namespace forcegrid::evaluation
