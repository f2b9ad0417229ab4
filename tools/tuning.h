#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::tools {

/// One way to run the loop, and what it came to: on a path that was recorded first, and, of those
/// that are worth it, in the loop itself.
struct TuningRow {
  double rate_Hz = 500.0;
  int fill_budget = 1000;  ///< vertices a cycle; without meaning for methods without a grid
  std::string method;      ///< MethodVariant
  std::string problem;     ///< empty, or why it could not be measured

  /// RMS after the first second, of the RMS of the reference force; NaN: not judged.
  double path_error_percent = std::numeric_limits<double>::quiet_NaN();
  double method_us = 0.0;  ///< mean time of a cycle in the method, its samples included

  /// Largest stiffness up to which the simulated loop is stable, over the largest of the path; NaN:
  /// not simulated.
  double stability_margin = std::numeric_limits<double>::quiet_NaN();

  bool measured = false;  ///< in the loop; what follows is nothing otherwise
  double error_percent = 0.0;
  double missed_percent = 0.0;
  double period_p99_us = 0.0;
  double compute_p50_us = 0.0;  ///< of a whole cycle: device, guards, method
  double compute_p99_us = 0.0;
  double backlog_percent = 0.0;  ///< fills that the budget cut short, of the samples taken

  /// [%] of one processor that the method takes: what is cheap is judged by it, since the rest of a
  /// cycle is the same for all.
  double method_percent() const { return 1e-4 * method_us * rate_Hz; }
  /// In the loop where that is known, else on the path.
  double known_error_percent() const { return measured ? error_percent : path_error_percent; }
};

/// What the user can live with.
struct TuningTolerance {
  double error_percent = 5.0;
  double missed_percent = 0.1;
  double compute_share = 0.5;     ///< of a period, at the 99th percentile
  double stability_margin = 1.0;  ///< at least
};

struct TuningChoice {
  std::optional<std::size_t> chosen;        ///< the cheapest that meets the tolerance
  std::optional<std::size_t> next_cheaper;  ///< the dearest of the cheaper ones: none of them does
  std::string reason;
};

/// The least of one method that is good enough on the path: its smallest grid, its shortest
/// dictionary.
struct LeastVariant {
  std::size_t least = 0;
  /// Of the same method at the same rate, which is not good enough.
  std::optional<std::size_t> next_smaller;
};

/// "kriging samples=8 at 250 Hz", with the budget where the method has a grid.
std::string name_of(const TuningRow& row);

/// Whether a method fills a grid, so that the fill budget matters to it.
bool has_grid(const std::string& method);

/// Whether a row takes less of a processor than another, in steps of 25 %, within which the lower
/// rate goes first, then the smaller budget.
bool cheaper(const TuningRow& a, const TuningRow& b);

/// Why a row does not meet `tolerance`; empty if it does. What is not known is no objection, except
/// that a row that has not been judged on the path, or was not measured, can't be chosen.
std::string objection(const TuningRow& row, const TuningTolerance& tolerance);

/// The cheapest row that was measured in the loop and meets `tolerance`.
TuningChoice choose(const std::vector<TuningRow>& rows, const TuningTolerance& tolerance);

/// For each method of which there are variants that differ: its cheapest that meets the tolerated
/// error on the path.
std::vector<LeastVariant> least_variants(const std::vector<TuningRow>& rows,
                                         const TuningTolerance& tolerance);

}  // namespace forcegrid::tools
