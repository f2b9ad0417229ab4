// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>

namespace forcegrid::kriging {

/// Costs of `auto` in bare trilinear reads, fitted to `kriging` with 4 to 32 samples
/// (docs/kriging.md, "Budget"). They are a model: machines differ from it.
struct CostModel {
  static constexpr double kCycle = 8.5;            ///< observe(), and a query without samples
  static constexpr double kQueryPerSample = 0.03;  ///< of a query, for each sample of the field
  static constexpr double kPiece = 30.0;           ///< of a piece of work
  static constexpr double kPiecePerRow = 21.0;     ///< for each row of the factor
  static constexpr double kPiecePerUnit = 0.25;    ///< for each unit, which is half a row squared

  static double cycle_reads(int samples) noexcept { return kCycle + kQueryPerSample * samples; }
  /// @param units of ForceMethod::work().
  static double piece_reads(int units) noexcept {
    const double rows = std::sqrt(2.0 * units);
    return units == 0 ? 0.0 : kPiece + kPiecePerRow * rows + kPiecePerUnit * units;
  }
};

/// What `auto` has within a budget.
struct BudgetPlan {
  int samples;    ///< of the candidate that begins
  bool ensemble;  ///< whether it has others
};

/// The most that a budget pays for, with samples at 30 Hz in a loop at 500 Hz. The others of the
/// ensemble sleep most of the time; they are worth having where as much is left for them as the
/// first one takes.
BudgetPlan plan_for(std::optional<double> reads_per_cycle) noexcept;

/// The cost of a cycle with the smallest field that takes every second sample. A smaller budget is
/// no use.
double least_budget_reads() noexcept;
/// The same with a field of so many samples.
double least_budget_reads(int samples) noexcept;

/// A purse that keeps the mean cost of cycles within a budget: each cycle puts the budget in and
/// takes out what its query costs; work begins only while something is left, and takes out what it
/// cost, so that a piece may run it into debt. What is saved up is bounded, so that a rest is not
/// followed by a burst of more than kSaved_cycles budgets.
/// Real-time: nothing allocates, locks or throws. Threads: one.
class WorkBudget {
 public:
  static constexpr double kSaved_cycles = 100.0;

  /// Absent: no limit. @param reads_per_cycle must be positive.
  explicit WorkBudget(std::optional<double> reads_per_cycle) noexcept
      : limited_(reads_per_cycle.has_value()),
        reads_per_cycle_(reads_per_cycle.value_or(0.0)),
        purse_(kSaved_cycles * reads_per_cycle_) {}

  bool limited() const noexcept { return limited_; }

  /// From now on. What is saved up stays, within the new bound; a budget after none begins with all
  /// that can be saved. @param reads_per_cycle > 0; infinite: no limit.
  void set(double reads_per_cycle) noexcept {
    const bool was_limited = std::exchange(limited_, std::isfinite(reads_per_cycle));
    reads_per_cycle_ = limited_ ? reads_per_cycle : 0.0;
    const double most = kSaved_cycles * reads_per_cycle_;
    purse_ = was_limited ? std::min(purse_, most) : most;
  }

  /// A cycle begins. @param samples of the rendered field.
  void begin_cycle(int samples) noexcept {
    purse_ = std::min(purse_ + reads_per_cycle_ - CostModel::cycle_reads(samples),
                      kSaved_cycles * reads_per_cycle_);
  }
  /// Whether work of the rendered candidate may begin.
  bool allows() const noexcept { return !limited_ || purse_ > 0.0; }
  /// Whether other work may, of which none is in haste: it leaves half of what can be saved.
  bool allows_others() const noexcept {
    return !limited_ || purse_ > 0.5 * kSaved_cycles * reads_per_cycle_;
  }
  /// A piece of work was done. @param units of ForceMethod::work().
  void spend(int units) noexcept { purse_ -= CostModel::piece_reads(units); }

 private:
  bool limited_;
  double reads_per_cycle_;
  double purse_;
};

}  // namespace forcegrid::kriging
