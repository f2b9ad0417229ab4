// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/solver_contact.h"

#include <algorithm>
#include <cmath>

#include "log/log.h"
#include "simulator/touch/dynamic_contact.h"
#include "simulator/touch/reduced_contact.h"
#include "simulator/touch/two_rates_contact.h"

namespace forcegrid::simulator {
namespace {

constexpr double kReducedChecks_Hz = 30.0;
constexpr double kPatience_s = 2.0;  // without a new training state, before fewer are enough

ReducedObjectOptions reduced_options(const SolverOptions& solver, double rate_Hz) {
  ReducedObjectOptions options;
  options.solver = solver;
  options.check_every = std::max(1, static_cast<int>(std::lround(rate_Hz / kReducedChecks_Hz)));
  options.patience = std::max(1, static_cast<int>(std::lround(rate_Hz * kPatience_s)));
  options.say = [](const std::string& what) { log::info("solver", what); };
  return options;
}

}  // namespace

std::unique_ptr<ToolContact> make_solver_contact(const Scene& scene, const SolverChoice& solver,
                                                 const ToolOptions& tool, double rate_Hz) {
  switch (solver.kind) {
    case SolverKind::kDynamic:
      return make_dynamic_contact(scene, solver.dynamic, tool);
    case SolverKind::kTwoRates:
      return make_two_rates_contact(scene, solver.two_rates, tool);
    case SolverKind::kReduced:
      return make_reduced_contact(scene, reduced_options(solver.options, rate_Hz), tool);
    case SolverKind::kQuasiStatic:
    case SolverKind::kLocal:
    case SolverKind::kPressed:
      break;
  }
  return make_tool_contact(scene, solver.options, tool);
}

}  // namespace forcegrid::simulator
