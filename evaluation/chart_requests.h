#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "evaluation/chart.h"

namespace forcegrid::evaluation {

/// The request rates of a chart [1/s], the condition `ideal` among them as 0.
inline constexpr std::array<int, 4> kRequestRates_per_s{0, 30, 60, 120};

/// One figure of a method on a motion by how many answers a second it may ask for.
struct RequestRow {
  std::string method;
  std::string trajectory;
  std::string figure;  ///< in words
  /// [%] Of the RMS of |F_o|, one a rate; NaN where the selection has none, or the method can't.
  std::array<double, kRequestRates_per_s.size()> error_percent{};
  /// Answers over the whole motion, one a rate.
  std::array<std::size_t, kRequestRates_per_s.size()> answers{};
};

/// What requests bring to the methods that make them: of each motion the RMS error in the first
/// second and after it, of kVisits the first 67 ms of a contact. Empty if the chart has no
/// condition with requests, or no method that made one.
std::vector<RequestRow> requests_of(const Chart& chart, const std::string& scene);

/// The same as a table of the chart's page; empty without rows.
std::string requests_html(const Chart& chart, const std::string& scene);

}  // namespace forcegrid::evaluation
