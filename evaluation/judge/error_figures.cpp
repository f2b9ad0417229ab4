// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/error_figures.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace forcegrid::evaluation {
namespace {

constexpr double kAdaptationWindow_s = 0.5;
constexpr double kAdapted_percent = 5.0;

}  // namespace

double percentile(std::vector<double>& values, double p) {
  if (values.empty()) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const auto wanted = static_cast<std::size_t>(std::ceil(p * static_cast<double>(values.size())));
  const auto nth =
      values.begin() + static_cast<std::ptrdiff_t>(std::max<std::size_t>(wanted, 1) - 1);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

ErrorFigures error_figures(std::vector<double> error_N, double reference_rms_N) {
  ErrorFigures figures;
  if (error_N.empty() || !(reference_rms_N > 0.0)) {
    return figures;
  }
  double sum = 0.0;
  double largest_N = 0.0;
  for (const double error : error_N) {
    sum += error * error;
    largest_N = error <= largest_N ? largest_N : error;  // a NaN remains
  }
  const double to_percent = 100.0 / reference_rms_N;
  figures.rms_percent = to_percent * std::sqrt(sum / static_cast<double>(error_N.size()));
  figures.p95_percent = to_percent * percentile(error_N, 0.95);
  figures.max_percent = to_percent * largest_N;
  return figures;
}

double adaptation_s(const std::vector<double>& since_start_s, const std::vector<double>& error_N,
                    double reference_rms_N) {
  constexpr double kNever = std::numeric_limits<double>::quiet_NaN();
  double adapted_s = kNever;
  for (std::size_t i = 0; i < error_N.size();) {
    const double window = std::floor(since_start_s[i] / kAdaptationWindow_s);
    const double end_s = (window + 1.0) * kAdaptationWindow_s;
    std::vector<double> within;
    for (; i < error_N.size() && since_start_s[i] < end_s; ++i) {
      within.push_back(error_N[i]);
    }
    if (within.empty()) {
      within.push_back(error_N[i++]);  // an instant that rounding moved onto the window's end
    }
    if (!(error_figures(std::move(within), reference_rms_N).rms_percent < kAdapted_percent)) {
      adapted_s = kNever;
    } else if (std::isnan(adapted_s)) {
      adapted_s = end_s;
    }
  }
  return adapted_s;
}

ForceErrors force_errors(const std::vector<ErrorInstant>& instants) {
  ForceErrors errors;
  errors.largest_step_N = std::numeric_limits<double>::quiet_NaN();
  double reference_sum = 0.0;
  std::vector<double> since_start_s;
  std::vector<double> error_N;
  std::vector<double> first_N;
  std::vector<double> after_N;
  for (const ErrorInstant& instant : instants) {
    reference_sum += instant.reference_N2;
    since_start_s.push_back(instant.time_s - instants.front().time_s);
    error_N.push_back(instant.error_N);
    if (since_start_s.back() < 1.0) {
      first_N.push_back(instant.error_N);
      continue;
    }
    if (!after_N.empty() && !(instant.step_N <= errors.largest_step_N)) {
      errors.largest_step_N = instant.step_N;
    }
    after_N.push_back(instant.error_N);
  }
  errors.reference_rms_N = std::sqrt(reference_sum / static_cast<double>(instants.size()));
  errors.adaptation_s = adaptation_s(since_start_s, error_N, errors.reference_rms_N);
  errors.first_1s = error_figures(std::move(first_N), errors.reference_rms_N);
  errors.after_1s = error_figures(std::move(after_N), errors.reference_rms_N);
  return errors;
}

}  // namespace forcegrid::evaluation
