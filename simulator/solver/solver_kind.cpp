// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/solver_kind.h"

#include "simulator/mesh/error.h"
#include "text/nearest_name.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

constexpr char kAuto[] = "auto";
constexpr SolverKind kAskable[] = {SolverKind::kQuasiStatic, SolverKind::kLocal,
                                   SolverKind::kTwoRates, SolverKind::kReduced,
                                   SolverKind::kDynamic};

}  // namespace

const char* to_string(SolverKind kind) noexcept {
  switch (kind) {
    case SolverKind::kQuasiStatic:
      return "quasi_static";
    case SolverKind::kLocal:
      return "local";
    case SolverKind::kTwoRates:
      return "two_rates";
    case SolverKind::kReduced:
      return "reduced";
    case SolverKind::kDynamic:
      return "dynamic";
    case SolverKind::kPressed:
      return "pressed";
  }
  return "unknown";
}

const std::vector<std::string>& solver_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all{kAuto};
    for (const SolverKind kind : kAskable) {
      all.emplace_back(to_string(kind));
    }
    return all;
  }();
  return names;
}

std::optional<SolverKind> parse_solver(const std::string& name) {
  if (name == kAuto) {
    return std::nullopt;
  }
  for (const SolverKind kind : kAskable) {
    if (name == to_string(kind)) {
      return kind;
    }
  }
  throw Error("solver '" + name + "' is unknown; write one of: " + text::joined(solver_names()) +
              " (the nearest is " + text::nearest_name(name, solver_names()) + ")");
}

}  // namespace forcegrid::simulator
