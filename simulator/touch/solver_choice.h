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
  std::string why;            ///< in one line, for a user
  SolverOptions options;      ///< where kind is kQuasiStatic or kLocal; of queries in any case
  DynamicOptions dynamic;     ///< where kind is kDynamic
  TwoRatesOptions two_rates;  ///< where kind is kTwoRates
  /// The whole object can be solved in every cycle of a 500 Hz servo: the method direct is exact
  /// there and needs no simulator.
  bool small_enough_for_direct = false;
};

/// two_rates for `rate_Hz` answers a second, from `options`: from 100 on its moves are solved as
/// direct's are, where the force goes out before what the prediction left is mended.
TwoRatesOptions two_rates_options(double rate_Hz, const SolverOptions& options);

/// Picks by what the object is, size and tolerance. dynamic where it has dampers: with steps of 2
/// ms, or as much longer as an answer of 0.7 us a vertex and step needs to take two thirds of the
/// time between answers. An object with masses alone is solved by equilibria, as nothing but the
/// time steps would end its swinging. Of equilibria quasi_static where the longest answer that the
/// bench has seen for that many vertices leaves a third of the time between answers free,
///
///   t = 1.1 us V max(1, (V / 10,000)^(1/3)) (1 + 0.25 log10(1e-3 / tolerance)),
///
/// local where it does not: its time grows with what the tool disturbs. direct fits where 0.16 us V
/// is at most half a cycle of 2 ms. Source of the factors: docs/solvers.md.
///
/// two_rates and reduced have to be asked for.
/// @param asked  one of solver_names(); another than auto is taken as it is.
/// @param rate_Hz  answers a second; > 0.
/// @param options  what the chosen solver starts from.
/// @param dynamics  what of the object changes with time.
/// Throws Error for an unknown name, for dynamic without masses, and for two_rates with dampers.
SolverChoice choose_solver(std::optional<SolverKind> asked, std::size_t vertices, double rate_Hz,
                           const SolverOptions& options,
                           MeshDynamics dynamics = MeshDynamics::kNone);

}  // namespace forcegrid::simulator
