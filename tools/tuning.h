// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::tools {

/// Settings of the loop and their results: on the recorded path and, if they were promising, in the
/// loop itself.
struct TuningRow {
  double rate_Hz = 500.0;
  int fill_budget = 1000;  ///< vertices per cycle; ignored by methods without a grid
  std::string method;      ///< MethodVariant
  std::string problem;     ///< empty, or the reason why it could not be measured

  /// RMS error after the first second, in % of the RMS of the reference force; NaN: not evaluated.
  double path_error_percent = std::numeric_limits<double>::quiet_NaN();
  /// Mean time of a cycle in the method, samples included; at least timer_floor_us.
  double method_us = 0.0;
  double timer_floor_us = 0.0;  ///< Verdict::timer_floor_ns of that measurement

  /// Largest stiffness at which the simulated loop is stable, over the largest stiffness of the
  /// path; NaN: not simulated.
  double stability_margin = std::numeric_limits<double>::quiet_NaN();

  bool measured = false;  ///< in the loop; otherwise the following values are unset
  double error_percent = 0.0;
  double missed_percent = 0.0;
  double period_p99_us = 0.0;
  double compute_p50_us = 0.0;  ///< of a whole cycle: device, guards, method
  double compute_p99_us = 0.0;
  double backlog_percent = 0.0;  ///< fills that the budget cut short, in % of the samples taken

  /// [%] Share of one processor that the method takes. It decides which row is cheaper, because the
  /// rest of a cycle costs the same for all methods.
  double method_percent() const { return 1e-4 * method_us * rate_Hz; }
  /// Whether the method takes less time than the timer can tell from none.
  bool at_timer_floor() const { return timer_floor_us > 0.0 && method_us <= timer_floor_us; }
  /// Error in the loop if it was measured, otherwise on the path.
  double known_error_percent() const { return measured ? error_percent : path_error_percent; }
};

/// Limits that the user accepts.
struct TuningTolerance {
  double error_percent = 5.0;
  double missed_percent = 0.1;
  double compute_share = 0.5;     ///< of a period, at the 99th percentile
  double stability_margin = 1.0;  ///< at least
};

struct TuningChoice {
  std::optional<std::size_t> chosen;  ///< the cheapest that meets the tolerance
  /// The most expensive of the cheaper rows, none of which meets it.
  std::optional<std::size_t> next_cheaper;
  std::string reason;
};

/// The smallest variant of one method that is good enough on the path, e.g. the smallest grid or
/// dictionary.
struct LeastVariant {
  std::size_t least = 0;
  /// Next smaller variant of the same method at the same rate, which is not good enough.
  std::optional<std::size_t> next_smaller;
};

/// Describes a row: "kriging samples=8 at 250 Hz", with the budget if the method has a grid.
std::string name_of(const TuningRow& row);

/// Whether a method fills a grid and so depends on the fill budget.
bool has_grid(const std::string& method);

/// Whether row `a` takes less processor time than `b`, in steps of 25 %. Within a step the lower
/// rate is cheaper, then the smaller budget.
bool cheaper(const TuningRow& a, const TuningRow& b);

/// Returns why a row does not meet `tolerance`; empty if it does. Unknown values are no objection,
/// but a row that was not evaluated on the path, or not measured in the loop, can't be chosen.
std::string objection(const TuningRow& row, const TuningTolerance& tolerance);

/// Chooses the cheapest row that was measured in the loop and meets `tolerance`.
TuningChoice choose(const std::vector<TuningRow>& rows, const TuningTolerance& tolerance);

/// Returns, for each method with several variants, the cheapest one that meets the tolerated error
/// on the path.
std::vector<LeastVariant> least_variants(const std::vector<TuningRow>& rows,
                                         const TuningTolerance& tolerance);

}  // namespace forcegrid::tools
