#pragma once

#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// [kg] One a vertex: the object's mass spread over its springs in proportion to their length at
/// rest, half of each to either end, fixed vertices included.
std::vector<double> vertex_masses_kg(const SpringMesh& mesh, double mass_kg);

/// How an object moves by itself, and what stops it.
struct ObjectDynamics {
  double mass_kg = 0.0;  ///< of the whole object; > 0
  /// [s] tau of every spring, home springs included: a damper of k tau beside it (Kelvin and
  /// Voigt); >= 0.
  double retardation_time_s = 0.0;
  double mass_damping_per_s = 0.0;  ///< alpha: every vertex is slowed by alpha m v; >= 0
};

/// Gives the object masses and dampers.
/// Throws Error for values out of range.
void give_dynamics(SpringMesh& mesh, const ObjectDynamics& dynamics);

/// What of an object changes with time.
enum class MeshDynamics {
  kNone,    ///< no masses: equilibria are all there is
  kMasses,  ///< masses alone: set swinging, it goes on for ever
  kDamped,  ///< masses and dampers
};
MeshDynamics dynamics_of(const SpringMesh& mesh) noexcept;

}  // namespace forcegrid::simulator
