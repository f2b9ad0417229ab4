// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace forcegrid::simulator {

/// What a ReducedObject did.
struct ReducedUse {
  std::uint64_t answers = 0;        ///< of a reduced model
  std::uint64_t full_answers = 0;   ///< of the full object, to moves in contact
  std::uint64_t out_of_reach = 0;   ///< of them: too far from the training states
  std::uint64_t not_converged = 0;  ///< of them: the model found no equilibrium
  std::uint64_t checks = 0;         ///< of a model against the full object
  std::uint64_t failed_checks = 0;
  double worst_check = 0.0;  ///< the largest error of a check, as check_tolerance counts it
  std::uint64_t trainings = 0;
  double training_s = 0.0;  ///< wall time of the last one
  std::size_t states = 0;   ///< that the last one was made from
  int modes = 0;            ///< of the last model
  std::size_t springs = 0;
  bool in_use = false;  ///< the last answer was a model's
};

}  // namespace forcegrid::simulator
