// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/pressed_turning.h"

#include <algorithm>
#include <limits>

#include "simulator/solver/cross_matrix.h"

namespace forcegrid::simulator {
namespace {

constexpr int kTurningRounds = 12;
constexpr double kTurningTolerance =
    0.02;  // of |K T|, relative to the stiffness and the lever arms
constexpr double kTurningAim = 0.3;
constexpr double kTurningLag = 0.02;  // what a constraint may still give, relative to the lever arm

}  // namespace

void PressedTurning::reserve(std::size_t loads) {
  springs_.reserve(loads);
  loads_.reserve(loads);
}

Eigen::Vector3d PressedTurning::place(const PointLoad& load) const noexcept {
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    place += load.weight[k] * springs_.position(static_cast<std::size_t>(load.vertex[k]));
  }
  return place;
}

Eigen::Matrix3d PressedTurning::lag(const PointLoad& load, const PressedSprings& springs) noexcept {
  Eigen::Matrix3d lag = load.tool_motion_W;
  for (std::size_t k = 0; k < 3; ++k) {
    lag -= load.weight[k] * springs.sensitivity(static_cast<std::size_t>(load.vertex[k]));
  }
  return lag;
}

double PressedTurning::substitute() noexcept {
  double largest_m = 0.0;
  for (PointLoad& load : loads_) {
    const Eigen::Matrix3d pull = load.reaction.rigid_stiffness_W * lag(load, springs_);
    load.known_pull_W += pull;
    largest_m = std::max(largest_m, pull.norm() / load.reaction.rigid_stiffness_W.norm());
  }
  return largest_m;
}

PressedTurning::Found PressedTurning::solve(const PressedSprings& lead,
                                            const std::vector<PointLoad>& loads,
                                            const Eigen::Vector3d& tool_place,
                                            double stiffness_N_per_m, int max_iterations) noexcept {
  Found found;
  springs_.take_positions(lead);
  loads_.assign(loads.begin(), loads.end());
  double reach_m = 0.0;
  for (PointLoad& load : loads_) {
    const Eigen::Vector3d arm = place(load) - tool_place;
    reach_m = std::max(reach_m, arm.norm());
    load.tool_motion_W = -cross_matrix(arm);
    load.known_pull_W = load.reaction.state == Reaction::State::kHeld
                            ? Eigen::Matrix3d(Eigen::Matrix3d::Zero())
                            : Eigen::Matrix3d(-cross_matrix(load.reaction.force_W));
  }
  const double aim_N_per_rad = kTurningTolerance * stiffness_N_per_m * reach_m;
  springs_.evaluate(loads_, false);
  double lag_m = std::numeric_limits<double>::infinity();
  const auto settled = [&] {
    return lag_m <= kTurningLag * reach_m &&
           springs_.sensitivity_residual_N_per_m() <= aim_N_per_rad;
  };
  bool stable = true;
  for (int round = 0; round < kTurningRounds && stable && springs_.finite() && !settled();
       ++round) {
    const PressedSprings::Descent descent = springs_.descend(
        max_iterations, std::numeric_limits<double>::infinity(), kTurningAim * aim_N_per_rad);
    found.iterations += descent.iterations;
    stable = !descent.unstable;
    springs_.take_positions(lead);  // the positions are the lead's alone to correct
    lag_m = substitute();
    springs_.evaluate(loads_, false);
  }
  for (std::size_t p = 0; p < loads.size(); ++p) {
    const PointLoad& load = loads[p];
    const Eigen::Matrix3d behind = lag(load, lead);
    found.gradient_W_N +=
        loads_[p].tool_motion_W * (load.reaction.stiffness_W * behind + load.known_pull_W) -
        cross_matrix(load.reaction.force_W) * behind;
  }
  for (const PointLoad& load : loads_) {
    const Eigen::Matrix3d turned = load.tool_motion_W - lag(load, springs_);
    found.stiffness_W_Nm_per_rad +=
        cross_matrix(load.reaction.force_W) * turned +
        load.tool_motion_W * (load.reaction.stiffness_W * lag(load, springs_) + load.known_pull_W);
  }
  found.known = stable && settled() && springs_.finite() &&
                found.stiffness_W_Nm_per_rad.allFinite() && found.gradient_W_N.allFinite();
  return found;
}

}  // namespace forcegrid::simulator
