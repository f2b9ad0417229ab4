// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// Lets an object hang or stand under its own weight. Its rest shape becomes the equilibrium of its
/// springs with a dead load of m_i g downwards on every free vertex, found by Newton's method in
/// double precision; elements keep where they are without strain. The mass is distributed as
/// vertex_masses_kg() does; the ground bears the
/// weight of fixed vertices. Natural lengths and home springs keep their values. A mesh with a
/// surface is then raised as a whole, so that its surface lies at top_W again.
/// @param mass_kg  of the object; > 0.
/// @param gravity_m_per_s2  along -z of W; > 0.
/// Throws Error for values out of range, and for an object too heavy for its springs to find rest.
void settle_under_gravity(SpringMesh& mesh, double mass_kg, double gravity_m_per_s2);

}  // namespace forcegrid::simulator
