// SPDX-License-Identifier: Apache-2.0
#include "tools/tuning.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <tuple>

namespace forcegrid::tools {
namespace {

constexpr double kAlike = 1.25;  // largest ratio between repeated measurements

std::string percent(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g %%", value);
  return text;
}

std::string first_word(const std::string& text) { return text.substr(0, text.find(' ')); }

// Why a row fails independently of the loop.
std::string objection_before_loop(const TuningRow& row, const TuningTolerance& tolerance) {
  if (!row.problem.empty()) {
    return row.problem;
  }
  if (!(row.known_error_percent() <= tolerance.error_percent)) {
    return "error " + percent(row.known_error_percent()) + " above " +
           percent(tolerance.error_percent) + (row.measured ? "" : " on the recorded path");
  }
  if (row.stability_margin < tolerance.stability_margin) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "in simulated time it is stable only up to %.2f times the stiffness of the path, "
                  "less than %g",
                  row.stability_margin, tolerance.stability_margin);
    return text;
  }
  return "";
}

std::string reason_for_none(const std::vector<TuningRow>& rows, const TuningTolerance& tolerance) {
  const auto rank = [](const TuningRow& row) {
    const double error_percent = row.known_error_percent();
    return std::make_pair(!row.problem.empty(), std::isnan(error_percent)
                                                    ? std::numeric_limits<double>::infinity()
                                                    : error_percent);
  };
  const auto best =
      std::min_element(rows.begin(), rows.end(),
                       [&](const TuningRow& a, const TuningRow& b) { return rank(a) < rank(b); });
  std::string reason = "no setting meets the tolerance";
  if (best != rows.end()) {
    reason += "; nearest: " + name_of(*best) + " (" + objection(*best, tolerance) + ")";
  }
  return reason;
}

}  // namespace

bool has_grid(const std::string& method) { return method.starts_with("forcegrid"); }

std::string name_of(const TuningRow& row) {
  char text[64];
  std::snprintf(text, sizeof text, has_grid(row.method) ? " at %.0f Hz, budget %d" : " at %.0f Hz",
                row.rate_Hz, row.fill_budget);
  return row.method + text;
}

bool cheaper(const TuningRow& a, const TuningRow& b) {
  const auto rank = [](const TuningRow& row) {
    const double step = std::floor(std::log(row.method_percent()) / std::log(kAlike));
    return std::make_tuple(step, row.rate_Hz, row.fill_budget, row.method_percent());
  };
  return rank(a) < rank(b);
}

std::string objection(const TuningRow& row, const TuningTolerance& tolerance) {
  std::string before = objection_before_loop(row, tolerance);
  if (!before.empty()) {
    return before;
  }
  if (!row.measured) {
    return "not measured in the loop; give more --time";
  }
  if (!(row.missed_percent <= tolerance.missed_percent)) {
    return percent(row.missed_percent) + " of the deadlines missed, above " +
           percent(tolerance.missed_percent);
  }
  const double share = 1e-6 * row.compute_p99_us * row.rate_Hz;
  if (!(share <= tolerance.compute_share)) {
    return "one cycle in 100 computes for " + percent(100.0 * share) + " of its period, above " +
           percent(100.0 * tolerance.compute_share);
  }
  return "";
}

TuningChoice choose(const std::vector<TuningRow>& rows, const TuningTolerance& tolerance) {
  TuningChoice choice;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (objection(rows[i], tolerance).empty() &&
        (!choice.chosen || cheaper(rows[i], rows[*choice.chosen]))) {
      choice.chosen = i;
    }
  }
  if (!choice.chosen) {
    choice.reason = reason_for_none(rows, tolerance);
    return choice;
  }
  const TuningRow& chosen = rows[*choice.chosen];
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].problem.empty() && cheaper(rows[i], chosen) &&
        (!choice.next_cheaper || cheaper(rows[*choice.next_cheaper], rows[i]))) {
      choice.next_cheaper = i;
    }
  }
  choice.reason = name_of(chosen) + " meets the tolerance with an error of " +
                  percent(chosen.error_percent) + ", its method taking " +
                  (chosen.at_timer_floor() ? "at most " : "") + percent(chosen.method_percent()) +
                  " of a processor; ";
  choice.reason += choice.next_cheaper ? "next cheaper is " + name_of(rows[*choice.next_cheaper]) +
                                             ": " + objection(rows[*choice.next_cheaper], tolerance)
                                       : "no setting tried is cheaper";
  return choice;
}

std::vector<LeastVariant> least_variants(const std::vector<TuningRow>& rows,
                                         const TuningTolerance& tolerance) {
  std::map<std::string, std::vector<std::size_t>> by_method;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].problem.empty() && std::isfinite(rows[i].path_error_percent)) {
      by_method[first_word(rows[i].method)].push_back(i);
    }
  }
  std::vector<LeastVariant> leasts;
  for (auto& [method, indices] : by_method) {
    std::sort(indices.begin(), indices.end(),
              [&](std::size_t a, std::size_t b) { return cheaper(rows[a], rows[b]); });
    const auto good = std::find_if(indices.begin(), indices.end(), [&](std::size_t i) {
      return rows[i].path_error_percent <= tolerance.error_percent;
    });
    if (good == indices.end()) {
      continue;
    }
    LeastVariant found{*good, std::nullopt};
    for (auto smaller = indices.begin(); smaller != good; ++smaller) {
      if (rows[*smaller].method != rows[*good].method &&
          rows[*smaller].rate_Hz == rows[*good].rate_Hz) {
        found.next_smaller = *smaller;
      }
    }
    const bool varied = std::any_of(indices.begin(), indices.end(), [&](std::size_t i) {
      return rows[i].method != rows[*good].method;
    });
    if (varied) {
      leasts.push_back(found);
    }
  }
  return leasts;
}

}  // namespace forcegrid::tools
