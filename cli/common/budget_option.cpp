// SPDX-License-Identifier: Apache-2.0
#include "cli/common/budget_option.h"

#include <algorithm>
#include <cstdio>
#include <sstream>
#include <stdexcept>

#include "cli/common/number_check.h"
#include "evaluation/judge/baseline_cost.h"
#include "log/log.h"

namespace forcegrid::cli {
namespace {

constexpr double kLeastBudget_us = 0.01;
constexpr double kMostBudget_us = 1000.0;

bool keeps_a_budget(const std::string& method) {
  std::string name;
  std::istringstream(method) >> name;
  return name == "auto";
}

}  // namespace

void add_budget(Command& command, BudgetOption& budget) {
  command
      .add_option("--budget-us", budget.us,
                  "What a cycle of method auto may cost on average: it takes as many samples and "
                  "candidates as that pays for (default no limit)")
      ->check(between(kLeastBudget_us, kMostBudget_us))
      ->type_name("FLOAT us");
}

std::optional<double> budget_reads(const BudgetOption& budget,
                                   const std::vector<std::string>& methods) {
  if (!budget.us) {
    return std::nullopt;
  }
  if (std::none_of(methods.begin(), methods.end(), keeps_a_budget)) {
    if (budget.on_command_line) {
      throw std::runtime_error(
          "--budget-us: only method auto keeps a budget, and it is not among the methods; add it, "
          "or leave --budget-us out");
    }
    log::info("method", "budget-us of the configuration has no effect: only method auto keeps it");
    return std::nullopt;
  }
  const double read_ns = evaluation::bare_trilinear_read_ns();
  const double reads = 1e3 * *budget.us / read_ns;
  char text[160];
  std::snprintf(text, sizeof text,
                "Budget of auto: %g us a cycle, which is %.0f bare trilinear reads of %.1f ns on "
                "this machine",
                *budget.us, reads, read_ns);
  log::info("method", text);
  return reads;
}

}  // namespace forcegrid::cli
