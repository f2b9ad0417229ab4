// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cli/common/options.h"

namespace forcegrid::cli {

struct BudgetOption {
  std::optional<double> us;      ///< of method auto, per cycle on average; absent: no limit
  bool on_command_line = false;  ///< and not from the configuration, which serves every method
};

/// Adds --budget-us. The command's callback has to set BudgetOption::on_command_line.
void add_budget(Command& command, BudgetOption& budget);

/// The budget in bare trilinear reads of this machine, whose time is measured in some 20 ms and
/// said in a message. Absent without a budget and, with a message, if none of the methods keeps
/// the one of the configuration.
/// @param methods MethodVariant texts that the budget is for.
/// @throws std::runtime_error if none of them keeps the one on the command line.
std::optional<double> budget_reads(const BudgetOption& budget,
                                   const std::vector<std::string>& methods);

}  // namespace forcegrid::cli
