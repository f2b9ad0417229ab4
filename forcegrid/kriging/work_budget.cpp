// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/work_budget.h"

#include "forcegrid/kriging/default_fields.h"

namespace forcegrid::kriging {
namespace {

// Fewer are worse than leaving out some of the simulator's samples.
constexpr int kFewestSamples = 6;
constexpr double kLeastTaken = 0.5;  // share of the simulator's samples
constexpr double kSamplesPerCycle = 30.0 / 500.0;
constexpr double kEnsembleOverOne = 2.0;

// [reads] Of a cycle with a field of so many samples and nothing else, which takes this share of
// the simulator's.
double alone_reads(int samples, double taken = 1.0) noexcept {
  const int rows = 3 * samples;
  return CostModel::cycle_reads(samples) +
         taken * kSamplesPerCycle * CostModel::piece_reads(1 + rows * rows / 2);
}

}  // namespace

double least_budget_reads() noexcept { return least_budget_reads(kFewestSamples); }

double least_budget_reads(int samples) noexcept { return alone_reads(samples, kLeastTaken); }

BudgetPlan plan_for(std::optional<double> reads_per_cycle) noexcept {
  if (!reads_per_cycle) {
    return {kDefaultSamples, true};
  }
  BudgetPlan plan{kDefaultSamples, false};
  plan.ensemble = *reads_per_cycle >= kEnsembleOverOne * alone_reads(kDefaultSamples);
  while (plan.samples > kFewestSamples && alone_reads(plan.samples) > *reads_per_cycle) {
    --plan.samples;
  }
  return plan;
}

}  // namespace forcegrid::kriging
