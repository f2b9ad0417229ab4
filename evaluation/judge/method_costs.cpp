// SPDX-License-Identifier: Apache-2.0
#include "evaluation/judge/method_costs.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

#include "evaluation/judge/error_figures.h"

namespace forcegrid::evaluation {

CostMeter::CostMeter(std::size_t cycles) {
  query_ns_.reserve(cycles);
  cycle_ns_.reserve(cycles);
}

void CostMeter::take_least(std::vector<double>& least_ns) {
  if (least_ns.empty()) {
    least_ns = cycle_ns_;
  }
  if (least_ns.size() != cycle_ns_.size()) {
    throw std::invalid_argument("least_cycle_ns holds " + std::to_string(least_ns.size()) +
                                " cycles, but the trace has " + std::to_string(cycle_ns_.size()));
  }
  for (std::size_t i = 0; i < cycle_ns_.size(); ++i) {
    cycle_ns_[i] = least_ns[i] = std::min(least_ns[i], cycle_ns_[i]);
  }
}

MethodCosts CostMeter::costs() {
  const double floor_ns = stopwatch_.floor_ns();
  const double floor_of_query_ns = floor_ns / static_cast<double>(kQueriesInARow);
  const auto at_least = [](double least_ns, double ns) {
    return ns < least_ns ? least_ns : ns;  // a NaN remains
  };
  const auto time_ns = [&](std::vector<double>& times_ns, double p) {
    return at_least(floor_ns, percentile(times_ns, p));
  };
  MethodCosts costs;
  costs.timer_floor_ns = floor_ns;
  costs.query_ns_median = at_least(floor_of_query_ns, percentile(query_ns_, 0.5));
  costs.query_ns_p99 = at_least(floor_of_query_ns, percentile(query_ns_, 0.99));
  costs.sample_us_median = 1e-3 * time_ns(sample_ns_, 0.5);
  costs.sample_us_p99 = 1e-3 * time_ns(sample_ns_, 0.99);
  costs.cycle_ns =
      cycle_ns_.empty()
          ? std::numeric_limits<double>::quiet_NaN()
          : at_least(floor_ns, std::accumulate(cycle_ns_.begin(), cycle_ns_.end(), 0.0) /
                                   static_cast<double>(cycle_ns_.size()));
  costs.cycle_ns_median = time_ns(cycle_ns_, 0.5);
  costs.cycle_ns_p99 = time_ns(cycle_ns_, 0.99);
  costs.cycle_ns_p999 = time_ns(cycle_ns_, 0.999);
  return costs;
}

}  // namespace forcegrid::evaluation
