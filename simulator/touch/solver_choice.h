// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "simulator/mesh/vertex_masses.h"
#include "simulator/solver/dynamic_object.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_kind.h"
#include "simulator/solver/two_rates_object.h"

namespace forcegrid::simulator {

/// The solver that a scene is simulated with.
struct SolverChoice {
  SolverKind kind = SolverKind::kQuasiStatic;
  std::string why;            ///< one line for a user
  SolverOptions options;      ///< for kQuasiStatic and kLocal, and always for queries
  DynamicOptions dynamic;     ///< for kDynamic
  TwoRatesOptions two_rates;  ///< for kTwoRates
  /// Whether a 500 Hz servo can solve the whole object in every cycle. The method direct is then
  /// exact and needs no simulator.
  bool small_enough_for_direct = false;
};

/// Options of two_rates for `rate_Hz` answers per second, starting from `options`. From 100 Hz on,
/// moves are solved as the method direct solves them: the force is sent before the residual of the
/// prediction is corrected.
TwoRatesOptions two_rates_options(double rate_Hz, const SolverOptions& options);

/// Chooses a solver by the object's dynamics, its size and the tolerance:
///
/// - dynamic if the object has dampers. Its time steps are 2 ms, or long enough that an answer at
///   0.7 us per vertex and step takes two thirds of the time between answers.
/// - quasi_static if the longest answer leaves a third of the time between answers free. For V
///   vertices that answer takes
///
///     t = 1.1 us V max(1, (V / 10,000)^(1/3)) (1 + 0.25 log10(1e-3 / tolerance))
///
/// - local otherwise: its time grows with what the tool disturbs, not with the object.
///
/// An object with masses but no dampers is solved for equilibria, since its oscillation would never
/// end. two_rates and reduced are used only on request. The method direct fits if 0.16 us V is at
/// most half of a 2 ms cycle. Source of the factors: docs/solvers.md.
/// @param asked  nothing: choose; else this solver is taken.
/// @param rate_Hz  answers per second; > 0.
/// @param options  the options that the chosen solver starts from.
/// @param dynamics  which parts of the object change with time.
/// Throws Error for dynamic without masses and for two_rates with dampers.
SolverChoice choose_solver(std::optional<SolverKind> asked, std::size_t vertices, double rate_Hz,
                           const SolverOptions& options,
                           MeshDynamics dynamics = MeshDynamics::kNone);

}  // namespace forcegrid::simulator
