// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "simulator/mesh/element_material.h"

namespace forcegrid::simulator {

/// How a spring's tension grows with its strain e = l / l0 - 1:
///
///   f = k l0 (g(e) + c e^3)      [N], positive when stretched
///   g(e) = e for a = 0, sinh(a e) / a otherwise
///
/// c = a = 0 is the linear law. c = 5 hardens as soft tissue does (twice the stiffness at 26 %
/// strain); a = 4 does so exponentially (twice at 33 %, five times at 57 %).
///
/// In a DynamicObject, a damper beside the spring adds k tau dl/dt: Kelvin's and Voigt's model,
/// whose stretch under a sudden load settles as 1 - exp(-t / tau). Equilibria do not depend on it.
struct SpringLaw {
  double cubic_coefficient = 0.0;   ///< c >= 0, dimensionless
  double exponent = 0.0;            ///< a >= 0, dimensionless
  double retardation_time_s = 0.0;  ///< tau >= 0, viscosity over stiffness
};

/// One spring between the vertices `a` and `b`.
struct Spring {
  std::int32_t a = 0;
  std::int32_t b = 0;
  double stiffness_N_per_m = 0.0;  ///< k: slope of the force at the natural length; > 0
  double natural_length_m = 0.0;   ///< l0; 0: its length in the mesh's rest shape
  std::int32_t law = 0;            ///< index into SpringMesh::laws
  bool severed = false;            ///< by a cut, see with_cut(): the stiffness is what is left
};

/// A finite element: a linear tetrahedron. The order of its vertices has no meaning.
struct Tetrahedron {
  std::array<std::int32_t, 4> vertex{};
  std::int32_t material = 0;  ///< index into SpringMesh::materials
};

/// An elastic object at rest: what the solver starts from. It consists of springs, of finite
/// elements (tetrahedra.h), or of both. W is the workspace frame.
///
/// A vertex may have a home spring, which pulls it to its rest position, and a dead load, which
/// keeps its direction and size: the turgor of an organ, or its weight. Masses and dampers are for
/// DynamicObject alone; the other solvers' answers are equilibria.
struct SpringMesh {
  std::vector<Eigen::Vector3d> rest_position_W;  ///< [m] in equilibrium
  std::vector<std::uint8_t> fixed;               ///< one per vertex; 1: never moves
  std::vector<Spring> springs;
  std::vector<SpringLaw> laws{SpringLaw{}};
  std::vector<Tetrahedron> tetrahedra;
  std::vector<ElementMaterial> materials;
  /// [m] Where the tetrahedra are without strain; empty: at rest.
  std::vector<Eigen::Vector3d> unstrained_W;
  std::vector<double> home_stiffness_N_per_m;  ///< empty, or one per vertex, >= 0
  std::vector<Eigen::Vector3d> load_W_N;       ///< empty, or one per vertex
  std::vector<double> mass_kg;                 ///< empty, or one per vertex, > 0 for free ones
  /// Empty, or one per vertex, >= 0: drag against the vertex's own velocity.
  std::vector<double> drag_Ns_per_m;

  /// Where a tool can touch: triangles of vertices, counterclockwise seen from outside.
  std::vector<std::array<std::int32_t, 3>> triangles;
  /// [m] A point of that surface that charts and measurements touch from above.
  Eigen::Vector3d top_W = Eigen::Vector3d::Zero();
};

/// l0 of a spring of the mesh.
double natural_length_m(const SpringMesh& mesh, const Spring& spring);

/// [N] The force of springs, elements, home springs and loads on each vertex at `position_W` [m].
std::vector<Eigen::Vector3d> vertex_forces_W(const SpringMesh& mesh,
                                             const std::vector<Eigen::Vector3d>& position_W);

/// Makes every force of the object `factor` times as large: springs with their dampers, elements,
/// home springs, loads and drag; > 0. Masses stay the same.
void scale_forces(SpringMesh& mesh, double factor);

/// Stretches every spring by `pre_strain` >= 0 in the rest shape, balances that with dead loads on
/// the free vertices, and gives every vertex a home spring of `home_stiffness_N_per_m` >= 0.
void tighten(SpringMesh& mesh, double pre_strain, double home_stiffness_N_per_m);

/// Adds `object` to what `mesh` already holds; an empty mesh becomes the object, top included.
void append(const SpringMesh& object, SpringMesh& mesh);

/// [N] A force that the object can exert at large strain, against which balances are judged: the
/// largest k l0, or E V^(2/3) of an element.
double force_scale_N(const SpringMesh& mesh);

/// Throws Error when the mesh can't be solved: no vertex, no spring and no element, an array of
/// another size,
/// nothing fixed and no home spring (the object would float), a spring or triangle that names a
/// missing vertex or law or the same vertex twice, a spring without length, a stiffness that is not
/// positive and finite, a position or load that is not finite, a law, mass or drag out of range, a
/// free vertex without a spring or element, a rest shape that is no equilibrium (to 1e-6 of
/// force_scale_N()), or what check_elements() refuses.
void check(const SpringMesh& mesh);

}  // namespace forcegrid::simulator
