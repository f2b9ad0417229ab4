// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/pressed_springs.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "simulator/kernels/coarse_correction.h"
#include "simulator/kernels/eigen_lanes.h"
#include "simulator/kernels/spring_table.h"
#include "simulator/mesh/tetrahedra.h"

namespace forcegrid::simulator {
namespace {

using kernels::BlockInverse;
using kernels::Float4;
using kernels::Lanes;

constexpr double kConvergedLane = 1e-13;  // of the initial value: the limit of single precision
// A correction that moves a vertex farther than this part of a spring is shortened.
constexpr double kLargestMoveOverLength = 0.5;

Float4 lanes(double x) {
  const auto single = static_cast<float>(x);
  return Float4{single, single, single, single};
}

void add(BlockInverse& block, const Eigen::Matrix3d& stiffness, double factor) {
  for (int c = 0; c < 3; ++c) {
    block.diagonal[c] += static_cast<float>(factor * stiffness(c, c));
    block.off_diagonal[c] += static_cast<float>(factor * stiffness(c, (c + 1) % 3));
  }
}

}  // namespace

PressedSprings::PressedSprings(const SpringMesh& mesh) {
  refuse_elements(mesh, "a tool that slides: ", "give it a tool that sticks (--contact sticky)");
  const std::size_t n = mesh.rest_position_W.size();
  rest_.reserve(n);
  for (std::size_t i = 0; i < n; ++i) {
    rest_.push_back(mesh.rest_position_W[i] - mesh.top_W);
    free_.push_back(mesh.fixed[i] == 0 ? 1 : 0);
    if (mesh.fixed[i] != 0) {
      fixed_.push_back(i);
    }
  }
  SpringTable<double> table = make_spring_table<double>(mesh);
  springs_ = table.springs;
  rows_ = std::move(table.rows);
  constants_ = std::move(table.constants);
  exponential_ = table.exponential;
  vertex_force_ = make_vertex_forces(mesh, rest_);
  home_N_per_m_ = kernels::home_stiffness_N_per_m(vertex_force_);
  for (const Spring& spring : mesh.springs) {
    mean_length_m_ += natural_length_m(mesh, spring) / static_cast<double>(springs_);
  }
  for (auto* lanes_of :
       {&state_, &saved_state_, &residual_, &direction_, &product_, &state_before_}) {
    lanes_of->resize(n);
  }
  position_.resize(n);
  saved_position_.resize(n);
  base_position_.resize(n);
  correction_.resize(n);
  force_.resize(n);
  block_.resize(n);
  inverse_.resize(n);
  t_N_per_m_.resize(constants_.size());
  tangent_.resize(constants_.size());
  coarse_ = make_coarse_grid(rest_);
  coarse_residual_.resize(static_cast<std::size_t>(coarse_.node_count));
  coarse_correction_.resize(static_cast<std::size_t>(coarse_.node_count));
  rest();
  evaluate({}, false);
  invert_coarse(rows_, tangent_, vertex_force_, free_, coarse_);
  for (std::size_t i = 0; i < n; ++i) {
    const Float4& diagonal = block_[i].diagonal;
    stiffness_at_rest_N_per_m_.push_back(
        static_cast<double>(diagonal[0] + diagonal[1] + diagonal[2]) / 3.0);
  }
}

Eigen::Vector3d PressedSprings::position(std::size_t vertex) const noexcept {
  return kernels::to_vector(position_[vertex]);
}

Eigen::Matrix3d PressedSprings::sensitivity(std::size_t vertex) const noexcept {
  return kernels::sensitivity_of(state_[vertex]);
}

void PressedSprings::rest() noexcept {
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    state_[i] = Lanes{};
    position_[i] = kernels::to_precise(rest_[i]);
  }
  at_rest_ = true;
}

void PressedSprings::take_positions(const PressedSprings& other) noexcept {
  std::copy(other.position_.begin(), other.position_.end(), position_.begin());
  at_rest_ = other.at_rest_;
}

void PressedSprings::predict(const Eigen::Vector3d& step) noexcept {
  std::copy(position_.begin(), position_.end(), saved_position_.begin());
  saved_at_rest_ = at_rest_;
  const Eigen::Vector3f step_m = step.cast<float>();
  kernels::predict(static_cast<std::int32_t>(rest_.size()), step_m.data(), 0.0F, state_.data(),
                   saved_state_.data());
  absorb_correction();
}

void PressedSprings::restore() noexcept {
  std::copy(saved_state_.begin(), saved_state_.end(), state_.begin());
  std::copy(saved_position_.begin(), saved_position_.end(), position_.begin());
  at_rest_ = saved_at_rest_;
  forget_direction();
}

// An unstable state may have left numbers here that are not finite, and the conjugate gradients
// begin by multiplying them by zero.
void PressedSprings::forget_direction() noexcept {
  std::fill(direction_.begin(), direction_.end(), Lanes{});
  std::fill(product_.begin(), product_.end(), Lanes{});
}

// Lane 0 of the state holds the correction to the positions until this adds it.
void PressedSprings::absorb_correction() noexcept {
  double largest_m = 0.0;
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      correction_[i][c] = state_[i].component[c][0];
      state_[i].component[c][0] = 0.0F;
    }
    largest_m = std::max(largest_m, static_cast<double>(correction_[i].norm()));
  }
  std::copy(position_.begin(), position_.end(), base_position_.begin());
  const double limit_m = kLargestMoveOverLength * mean_length_m_;
  shorten(largest_m > limit_m ? limit_m / largest_m : 1.0);
}

void PressedSprings::shorten(double factor) noexcept {
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    correction_[i] *= static_cast<float>(factor);
    for (int c = 0; c < 3; ++c) {
      position_[i].xyz[c] = base_position_[i].xyz[c] + static_cast<double>(correction_[i][c]);
    }
  }
}

void PressedSprings::make_convex() noexcept {
  for (kernels::SpringTangent& tangent : tangent_) {
    tangent.t_N_per_m = std::max(tangent.t_N_per_m, 0.0F);
  }
  for (PointLoad& load : loads_) {
    load.reaction.stiffness_W = load.reaction.convex_stiffness_W;
  }
}

void PressedSprings::evaluate(const std::vector<PointLoad>& loads, bool convex) noexcept {
  loads_.assign(loads.begin(), loads.end());
  kernels::evaluate(rows_, constants_.data(), exponential_, state_.data(), position_.data(),
                    t_N_per_m_.data(), force_.data(), residual_.data(), tangent_.data());
  kernels::add_vertex_forces(vertex_force_, state_.data(), position_.data(), force_.data(),
                             residual_.data());
  if (convex) {
    make_convex();
  }
  add_loads();
  fit_preconditioner();
  const kernels::StateSums sums =
      kernels::summarise(static_cast<std::int32_t>(rest_.size()), inverse_.data(), state_.data(),
                         residual_.data(), force_.data());
  residual_N_ = std::sqrt(sums.residual_squared_N2);
  force_gap_N_ = Eigen::Map<const Eigen::Vector3d>(sums.force_N).norm();
  sensitivity_N_per_m_ = std::sqrt(sums.sensitivity_squared[0] + sums.sensitivity_squared[1] +
                                   sums.sensitivity_squared[2]);
  for (const std::size_t i : fixed_) {
    residual_[i] = Lanes{};
  }
  at_rest_ = false;
}

void PressedSprings::add_loads() noexcept {
  for (const PointLoad& load : loads_) {
    Eigen::Matrix3d moves = load.tool_motion_W;
    for (std::size_t k = 0; k < 3; ++k) {
      moves -= load.weight[k] * sensitivity(static_cast<std::size_t>(load.vertex[k]));
    }
    const Eigen::Matrix3d pull = load.reaction.stiffness_W * moves + load.known_pull_W;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(load.vertex[k]);
      for (int c = 0; c < 3; ++c) {
        force_[i].xyz[c] += load.weight[k] * load.reaction.force_W[c];
        Float4& residual = residual_[i].component[c];
        residual[0] = static_cast<float>(force_[i].xyz[c]);
        for (int j = 0; j < 3; ++j) {
          residual[1 + j] += static_cast<float>(load.weight[k] * pull(c, j));
        }
      }
    }
  }
}

void PressedSprings::fit_preconditioner() noexcept {
  kernels::sum_blocks(rows_, tangent_.data(), block_.data());
  kernels::add_home_blocks(vertex_force_, block_.data());
  std::copy(block_.begin(), block_.end(), inverse_.begin());
  for (const PointLoad& load : loads_) {
    for (std::size_t k = 0; k < 3; ++k) {
      add(inverse_[static_cast<std::size_t>(load.vertex[k])], load.reaction.stiffness_W,
          load.weight[k] * load.weight[k]);
    }
  }
  for (std::size_t i = 0; i < inverse_.size(); ++i) {
    kernels::invert_block(inverse_[i], free_[i] != 0);
  }
}

bool PressedSprings::finite() const noexcept {
  return std::isfinite(residual_N_) && std::isfinite(sensitivity_N_per_m_) &&
         std::isfinite(force_gap_N_);
}

Float4 PressedSprings::apply_loads() noexcept {
  Float4 dot{};
  for (const PointLoad& load : loads_) {
    Float4 moved[3] = {};
    for (std::size_t k = 0; k < 3; ++k) {
      const Lanes& direction = direction_[static_cast<std::size_t>(load.vertex[k])];
      for (int c = 0; c < 3; ++c) {
        moved[c] += lanes(load.weight[k]) * direction.component[c];
      }
    }
    for (int c = 0; c < 3; ++c) {
      Float4 pull{};
      for (int d = 0; d < 3; ++d) {
        pull += lanes(load.reaction.stiffness_W(c, d)) * moved[d];
      }
      dot += pull * moved[c];
      for (std::size_t k = 0; k < 3; ++k) {
        product_[static_cast<std::size_t>(load.vertex[k])].component[c] +=
            lanes(load.weight[k]) * pull;
      }
    }
  }
  return dot;
}

PressedSprings::Descent PressedSprings::descend(int max_iterations, double residual_aim_N,
                                                double sensitivity_aim_N_per_m) noexcept {
  Descent result;
  const auto n = static_cast<std::int32_t>(rest_.size());
  const auto take_step = [&](Float4 alpha) {
    kernels::StepSums sums =
        kernels::take_step(n, alpha, inverse_.data(), coarse_, direction_.data(), state_.data(),
                           residual_.data(), product_.data(), coarse_residual_.data());
    sums.preconditioned +=
        kernels::solve_coarse(coarse_, coarse_residual_.data(), coarse_correction_.data());
    return sums;
  };
  const auto turn = [&](Float4 beta) {
    kernels::next_direction(n, beta, inverse_.data(), coarse_, coarse_correction_.data(),
                            direction_.data(), product_.data());
  };
  const auto spoilt = [&] {
    std::copy(state_before_.begin(), state_before_.end(), state_.begin());
    forget_direction();
    result.unstable = true;
    return result;
  };
  std::copy(state_.begin(), state_.end(), state_before_.begin());
  kernels::StepSums sums = take_step(Float4{});
  turn(Float4{});
  const Float4 first = sums.preconditioned;
  Float4 before = first;
  while (result.iterations < max_iterations) {
    const Float4 curvature =
        kernels::apply_stiffness(rows_, tangent_.data(),
                                 home_N_per_m_.empty() ? nullptr : home_N_per_m_.data(),
                                 direction_.data(), product_.data()) +
        apply_loads();
    Float4 alpha{};
    bool active = false;
    for (int lane = 0; lane < 4; ++lane) {
      if (!(before[lane] > first[lane] * static_cast<float>(kConvergedLane))) {
        continue;
      }
      if (!(curvature[lane] > 0.0F)) {
        return spoilt();
      }
      alpha[lane] = before[lane] / curvature[lane];
      active = true;
    }
    if (!active) {
      break;
    }
    sums = take_step(alpha);
    ++result.iterations;
    const double residual_N = std::sqrt(static_cast<double>(sums.squared[0]));
    const double sensitivity_N_per_m =
        std::sqrt(static_cast<double>(sums.squared[1]) + static_cast<double>(sums.squared[2]) +
                  static_cast<double>(sums.squared[3]));
    if (!std::isfinite(residual_N) || !std::isfinite(sensitivity_N_per_m)) {
      return spoilt();
    }
    if (residual_N <= residual_aim_N && sensitivity_N_per_m <= sensitivity_aim_N_per_m) {
      break;
    }
    Float4 beta{};
    for (int lane = 0; lane < 4; ++lane) {
      beta[lane] = before[lane] > 0.0F ? sums.preconditioned[lane] / before[lane] : 0.0F;
    }
    before = sums.preconditioned;
    turn(beta);
  }
  absorb_correction();
  return result;
}

}  // namespace forcegrid::simulator
