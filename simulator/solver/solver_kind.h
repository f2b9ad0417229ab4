// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace forcegrid::simulator {

/// How an object under a tool is solved; docs/solvers.md compares them.
enum class SolverKind {
  kQuasiStatic,  ///< equilibria of the whole object: ElasticObject
  kLocal,        ///< equilibria of what the tool disturbs: SolverOptions::border_tolerance
  kTwoRates,     ///< a bounded region now, the whole object behind it: TwoRatesObject
  kReduced,      ///< a reduced model that is learned during the grab: ReducedObject
  kDynamic,      ///< motion with masses and dampers: DynamicObject
  kPressed,      ///< contact with friction, for a tool that slides: PressedObject
};

/// As on the command line and in summaries; "pressed" for the kind that --solver does not offer.
const char* to_string(SolverKind kind) noexcept;

/// The values of --solver: auto, quasi_static, local, two_rates, reduced, dynamic.
const std::vector<std::string>& solver_names();

/// @returns nothing for "auto".
/// Throws Error for a name that solver_names() does not have; it states the nearest one.
std::optional<SolverKind> parse_solver(const std::string& name);

}  // namespace forcegrid::simulator
