#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::tools {

/// One way to run the loop, and what it came to.
struct TuningRow {
  double rate_Hz = 500.0;
  int fill_budget = 1000;      ///< vertices a cycle; without meaning for methods without a grid
  std::string method;          ///< MethodVariant
  std::string problem;         ///< empty, or why it could not be measured
  double error_percent = 0.0;  ///< RMS after the first second, of the RMS of the off-line force
  double missed_percent = 0.0;
  double period_p99_us = 0.0;
  double compute_p50_us = 0.0;
  double compute_p99_us = 0.0;
  double backlog_percent = 0.0;  ///< fills that the budget cut short, of the samples taken

  /// [%] of one processor.
  double processor_percent() const { return 1e-4 * compute_p50_us * rate_Hz; }
};

/// What the user can live with.
struct TuningTolerance {
  double error_percent = 5.0;
  double missed_percent = 0.1;
  double compute_share = 0.5;  ///< of a period, at the 99th percentile
};

struct TuningChoice {
  std::optional<std::size_t> chosen;        ///< the cheapest that meets the tolerance
  std::optional<std::size_t> next_cheaper;  ///< the dearest of the cheaper ones: none of them does
  std::string reason;
};

/// Why a row does not meet `tolerance`; empty if it does.
std::string objection(const TuningRow& row, const TuningTolerance& tolerance);

/// The cheapest row in processor time that meets `tolerance`; of equals the one of the lower rate.
TuningChoice choose(const std::vector<TuningRow>& rows, const TuningTolerance& tolerance);

/// Draws `folder`/tuning.svg and .png from tuning.csv, which it writes, too: error and misses
/// against rate, error against processor time, the chosen one marked.
/// @throws std::runtime_error when that can't be done.
std::vector<std::string> draw_tuning(const std::string& folder, const std::vector<TuningRow>& rows,
                                     const TuningChoice& choice);

}  // namespace forcegrid::tools
