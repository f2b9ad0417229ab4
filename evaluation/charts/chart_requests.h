// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "evaluation/charts/chart.h"

namespace forcegrid::evaluation {

/// The request rates of a chart [1/s], the condition `ideal` among them as 0.
inline constexpr std::array<int, 4> kRequestRates_per_s{0, 30, 60, 120};

/// One figure of a method on a motion for each rate of requests.
struct RequestRow {
  std::string method;
  std::string trajectory;
  std::string figure;  ///< in words
  /// [%] of the RMS of |F_o|, one per rate; NaN if the selection lacks the rate or the method makes
  /// no requests.
  std::array<double, kRequestRates_per_s.size()> error_percent{};
  /// Answers over the whole motion, one per rate.
  std::array<std::size_t, kRequestRates_per_s.size()> answers{};
};

/// Returns the effect of requests on the methods that make them: for each motion the RMS errors in
/// the first second and after it, for kVisits the error in the first 67 ms of a contact. Empty if
/// the chart has no condition with requests, or no method made one.
std::vector<RequestRow> requests_of(const Chart& chart, const std::string& scene);

/// The same as an HTML table for the chart's page; empty without rows.
std::string requests_html(const Chart& chart, const std::string& scene);

}  // namespace forcegrid::evaluation
