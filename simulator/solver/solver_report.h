// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "simulator/solver/reduced_use.h"

namespace forcegrid::simulator {

/// What a solver reports beside its answers; empty where it does not apply to the solver.
struct SolverReport {
  /// Of a DynamicObject: the last step covered more time than DynamicOptions::max_steps time steps.
  std::optional<bool> long_step{};
  /// Of a TwoRatesObject: solutions of the whole object that moves have taken so far.
  std::optional<std::uint64_t> whole_solutions{};
  /// Of a ReducedObject: what its models have done so far.
  std::optional<ReducedUse> reduced{};
};

}  // namespace forcegrid::simulator
