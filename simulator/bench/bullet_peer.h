// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/bench/solver_bench.h"

namespace forcegrid::simulator {

/// Bullet's btSoftBody as a peer of forcegrid simulate --bench: the same mesh with linear springs.
/// The kLST relaxation of its links is in proportion to their stiffness (`relaxation` for the
/// stiffest), halved for links to vertices that are held, since Bullet then moves one end only.
/// Equal masses, no gravity, no collisions, one position iteration per step. The force comes from
/// Bullet's positions by the springs' own law, which is its best case; reading it is not timed.
///
/// kLST is a relaxation factor, not a stiffness: the springs' equilibrium is its fixed point only
/// as it tends to 0.
/// @param relaxation  in (0, 1].
/// @param steps  the number of steps that it takes.
/// StepPeer::run throws Error for a scene of finite elements: btSoftBody's links have no material.
StepPeer bullet_peer(double relaxation, int steps = 800);

}  // namespace forcegrid::simulator
