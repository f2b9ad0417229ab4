// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "simulator/solver/state_with_sensitivities.h"

namespace forcegrid::simulator {

/// The cost of a descent in energy.
struct EnergyDescent {
  int evaluations = 0;
  int iterations = 0;  ///< of conjugate gradients
};

/// Leads from an unstable or diverging state downhill in energy to another branch of equilibria
/// while the tool stays where it is: truncated Newton steps with a backtracking line search, until
/// |r| is at most `relative_tolerance` max(|F|, `force_floor_N`), no lower energy is found, or
/// `max_steps` are done. Begins from the state before the last advance_to(), with the patch at its
/// new place, and overwrites that state. The region must be the whole object.
/// @param correction_m  scratch, one per vertex.
template <typename Real>
EnergyDescent descend_in_energy(StateWithSensitivities<Real>& state, int max_steps,
                                double relative_tolerance, double force_floor_N,
                                std::vector<Eigen::Vector3f>& correction_m) noexcept;

extern template EnergyDescent descend_in_energy(StateWithSensitivities<float>&, int, double, double,
                                                std::vector<Eigen::Vector3f>&) noexcept;
extern template EnergyDescent descend_in_energy(StateWithSensitivities<double>&, int, double,
                                                double, std::vector<Eigen::Vector3f>&) noexcept;

}  // namespace forcegrid::simulator
