// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/energy_descent.h"

#include <algorithm>
#include <cmath>

namespace forcegrid::simulator {
namespace {

constexpr int kIterations = 40;
constexpr int kMaxLineSearchTrials = 12;
constexpr double kLargestMove_m = 1e-3;
// Of the residual, for the conjugate gradients of one step; S waits until the state is found.
constexpr double kResidualAim = 0.1;
constexpr double kAnySensitivity_N_per_m = 1e30;

// Moves along the correction, first by `scale` of it and then half as far each time, until the
// energy is below `energy_J`, which it then replaces; otherwise returns to the saved state.
template <typename Real>
bool search(StateWithSensitivities<Real>& state, const std::vector<Eigen::Vector3f>& correction_m,
            double scale, double& energy_J) noexcept {
  const std::size_t vertices = state.vertex_count();
  for (int trial = 0; trial < kMaxLineSearchTrials; ++trial) {
    for (std::size_t i = 0; i < vertices; ++i) {
      const Eigen::Vector3d base = state.saved_position(i);
      state.set_position(i, base + scale * correction_m[i].template cast<double>());
    }
    const double trial_J = state.energy_J();
    if (trial_J < energy_J) {
      energy_J = trial_J;
      return true;
    }
    scale *= 0.5;
  }
  for (std::size_t i = 0; i < vertices; ++i) {
    state.set_position(i, state.saved_position(i));
  }
  return false;
}

}  // namespace

template <typename Real>
EnergyDescent descend_in_energy(StateWithSensitivities<Real>& state, int max_steps,
                                double relative_tolerance, double force_floor_N,
                                std::vector<Eigen::Vector3f>& correction_m) noexcept {
  EnergyDescent spent;
  state.restore_under_tool();
  double energy_J = state.energy_J();
  for (int step = 0; step < max_steps; ++step) {
    state.forget_preconditioner();
    const Evaluation found = state.evaluate();
    ++spent.evaluations;
    const double scale_N = std::max(found.force_W.norm(), force_floor_N);
    if (!found.finite() || found.residual_N <= relative_tolerance * scale_N) {
      return spent;
    }
    state.save();
    const Descent descent =
        state.descend(kIterations, kResidualAim * found.residual_N, kAnySensitivity_N_per_m);
    spent.iterations += descent.iterations;
    const bool no_way = descent.iterations == 0;
    state.take_correction(no_way, correction_m);
    double largest_m = 0.0;
    for (const Eigen::Vector3f& move : correction_m) {
      largest_m = std::max(largest_m, static_cast<double>(move.norm()));
    }
    if (!(largest_m > 0.0) || !std::isfinite(largest_m)) {
      return spent;
    }
    const double scale = largest_m > kLargestMove_m || no_way ? kLargestMove_m / largest_m : 1.0;
    if (!search(state, correction_m, scale, energy_J)) {
      return spent;
    }
  }
  return spent;
}

template EnergyDescent descend_in_energy(StateWithSensitivities<float>&, int, double, double,
                                         std::vector<Eigen::Vector3f>&) noexcept;
template EnergyDescent descend_in_energy(StateWithSensitivities<double>&, int, double, double,
                                         std::vector<Eigen::Vector3f>&) noexcept;

}  // namespace forcegrid::simulator
