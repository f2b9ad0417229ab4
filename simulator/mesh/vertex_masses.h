// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// [kg] One mass per vertex: the object's mass spread over its springs in proportion to their
/// length at rest, half of each to either end, fixed vertices included. If it has elements: spread
/// over these in proportion to volume and density, a quarter of each to every corner.
std::vector<double> vertex_masses_kg(const SpringMesh& mesh, double mass_kg);

/// Mass and damping of a dynamic object.
struct ObjectDynamics {
  double mass_kg = 0.0;  ///< of the whole object; > 0
  /// [s] tau of every spring, home springs included: a damper of k tau beside it (Kelvin and
  /// Voigt); >= 0.
  double retardation_time_s = 0.0;
  double mass_damping_per_s = 0.0;  ///< alpha: a drag of alpha m v on every vertex; >= 0
};

/// Gives the object masses and dampers.
/// Throws Error for values out of range.
void give_dynamics(SpringMesh& mesh, const ObjectDynamics& dynamics);

/// Which dynamics an object has.
enum class MeshDynamics {
  kNone,    ///< no masses: equilibria only
  kMasses,  ///< masses without dampers: an oscillation never ends
  kDamped,  ///< masses and dampers
};
MeshDynamics dynamics_of(const SpringMesh& mesh) noexcept;

}  // namespace forcegrid::simulator
