// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/state_with_sensitivities.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "simulator/kernels/coarse_correction.h"
#include "simulator/kernels/eigen_lanes.h"
#include "simulator/kernels/kernel_support.h"
#include "simulator/kernels/spring_table.h"

namespace forcegrid::simulator {
namespace {

using kernels::Float4;
using kernels::Lanes;

// A step longer than this many times the last one is predicted to first order only, so that errors
// of S don't grow, see kernels::predict().
constexpr double kLargestTrend = 2.0;
// The preconditioner tolerates this much motion before it is worth computing again.
constexpr double kPreconditionerReach_m = 3e-3;
// The coarse half costs as much as the springs' pass. In the first direction of a correction it
// does most of what it can do; after so many iterations it is worth its time in every one.
constexpr int kIterationsWithoutCoarse = 8;
// A lane below this fraction of its initial value is at the limit of single precision.
constexpr double kFinishedLane = 1e-13;

}  // namespace

bool Evaluation::finite() const noexcept {
  return std::isfinite(residual_N) && std::isfinite(sensitivity_residual_N_per_m) &&
         force_W.allFinite() && stiffness_W.allFinite();
}

template <typename Real>
StateWithSensitivities<Real>::StateWithSensitivities(const SpringMesh& mesh)
    : origin_W_(mesh.top_W),
      fixed_(mesh.fixed),
      region_(static_cast<std::int32_t>(mesh.rest_position_W.size())) {
  const std::size_t n = mesh.rest_position_W.size();
  rest_.reserve(n);
  for (const Eigen::Vector3d& position_W : mesh.rest_position_W) {
    rest_.push_back(position_W - origin_W_);
  }
  springs_ = mesh.springs.size();
  models_ = make_force_models<Real>(mesh);
  vertex_force_ = make_vertex_forces(mesh, rest_);
  home_N_per_m_ = kernels::home_stiffness_N_per_m(vertex_force_);
  mesh_number_.resize(n);
  std::iota(mesh_number_.begin(), mesh_number_.end(), 0);
  own_number_.assign(mesh_number_.begin(), mesh_number_.end());
  state_.resize(n);
  residual_.resize(n);
  direction_.resize(n);
  product_.resize(n);
  saved_state_.resize(n);
  inverse_.resize(n);
  if constexpr (kDouble) {
    position_.resize(n);
    saved_position_.resize(n);
    force_.resize(n);
  } else {
    single_position_.resize(n);
  }
  free_.resize(n);
  coarse_ = make_coarse_grid(rest_);
  coarse_residual_.resize(static_cast<std::size_t>(coarse_.node_count));
  coarse_correction_.resize(static_cast<std::size_t>(coarse_.node_count));
  release();
}

template <typename Real>
std::size_t StateWithSensitivities<Real>::memory_bytes() const noexcept {
  const auto bytes = [](const auto&... vectors) {
    return (... + (vectors.capacity() * sizeof(*vectors.data())));
  };
  std::size_t models = 0;
  for (const auto& model : models_) {
    models += model->memory_bytes();
  }
  return sizeof *this + models +
         bytes(rest_, fixed_, free_, patch_, patch_anchor_, others_, others_place_, mesh_number_,
               own_number_, models_, vertex_force_, home_N_per_m_, constrained_, pull_, state_,
               residual_, direction_, product_, saved_state_, inverse_, position_, saved_position_,
               force_, single_position_, coarse_.place, coarse_.cell, coarse_.member,
               coarse_.inverse_m_per_N, coarse_residual_, coarse_correction_);
}

template <typename Real>
void StateWithSensitivities<Real>::hold(std::vector<std::int32_t> patch, bool number_around) {
  patch_ = std::move(patch);
  if (number_around) {
    number_around_patch();
  }
  for (const std::int32_t i : patch_) {
    const auto at = static_cast<std::size_t>(i);
    free_[at] = 0;
    constrained_.push_back(i);
    patch_anchor_.push_back(rest_[at]);
    for (int c = 0; c < 3; ++c) {
      state_[at].component[c][1 + c] = 1.0F;
    }
  }
  pull_.resize(constrained_.size());
}

template <typename Real>
void StateWithSensitivities<Real>::share(std::vector<std::int32_t> patch,
                                         std::vector<Eigen::Vector3d> anchor,
                                         std::vector<std::int32_t> others, bool anew) {
  patch_ = std::move(patch);
  patch_anchor_ = std::move(anchor);
  others_ = std::move(others);
  others_place_.clear();
  constrained_.clear();
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    free_[i] = fixed_[i] == 0 ? 1 : 0;
    if (free_[i] == 0) {
      constrained_.push_back(static_cast<std::int32_t>(i));
    }
  }
  const auto set_sensitivity = [this](std::size_t i, float diagonal) {
    for (int c = 0; c < 3; ++c) {
      for (int j = 0; j < 3; ++j) {
        state_[i].component[c][1 + j] = c == j ? diagonal : 0.0F;
      }
    }
  };
  for (std::size_t i = 0; anew && i < rest_.size(); ++i) {
    set_sensitivity(i, 0.0F);
  }
  for (const std::int32_t i : others_) {
    const auto at = static_cast<std::size_t>(i);
    others_place_.push_back(position(at));
    set_sensitivity(at, 0.0F);
  }
  for (const std::int32_t i : patch_) {
    set_sensitivity(static_cast<std::size_t>(i), 1.0F);
  }
  for (const auto* held : {&patch_, &others_}) {
    for (const std::int32_t i : *held) {
      free_[static_cast<std::size_t>(i)] = 0;
      constrained_.push_back(i);
    }
  }
  pull_.resize(constrained_.size());
  if (anew) {
    displacement_.setZero();
  }
  saved_displacement_ = displacement_;
  preconditioner_valid_ = false;
  forget_trends();
}

template <typename Real>
void StateWithSensitivities<Real>::place_others(
    const std::vector<Eigen::Vector3d>& place) noexcept {
  std::copy_n(place.begin(), std::min(place.size(), others_place_.size()), others_place_.begin());
}

template <typename Real>
void StateWithSensitivities<Real>::set_patch_anchor(
    const std::vector<Eigen::Vector3d>& anchor) noexcept {
  std::copy_n(anchor.begin(), std::min(anchor.size(), patch_anchor_.size()), patch_anchor_.begin());
}

template <typename Real>
void StateWithSensitivities<Real>::release() noexcept {
  patch_.clear();
  patch_anchor_.clear();
  others_.clear();
  others_place_.clear();
  region_.whole(extent_);
  limit_models();
  stand_at_rest();
}

template <typename Real>
void StateWithSensitivities<Real>::stand_at_rest() noexcept {
  constrained_.clear();
  displacement_.setZero();
  saved_displacement_.setZero();
  trend_valid_ = false;
  preconditioner_valid_ = false;
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    free_[i] = fixed_[i] == 0 ? 1 : 0;
    if (free_[i] == 0) {
      constrained_.push_back(static_cast<std::int32_t>(i));
    }
    state_[i] = Lanes{};
    set_position(i, rest_[i]);
  }
  pull_.resize(constrained_.size());
}

// Grabbed first, then ring by ring, so that a region is the head of every array.
template <typename Real>
void StateWithSensitivities<Real>::number_around_patch() {
  std::vector<std::int32_t> lower;
  std::vector<std::int32_t> upper;
  for (const auto& model : models_) {
    lower.insert(lower.end(), model->lower().begin(), model->lower().end());
    upper.insert(upper.end(), model->upper().begin(), model->upper().end());
  }
  const std::vector<std::int32_t> order = region_.number_around(patch_, lower, upper);
  permute(order, rest_);
  permute(order, fixed_);
  permute(order, free_);
  permute(order, mesh_number_);
  if (!vertex_force_.empty()) {
    permute(order, vertex_force_);
    permute(order, home_N_per_m_);
  }
  for (const auto& model : models_) {
    model->renumber(order);
  }
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    own_number_[static_cast<std::size_t>(mesh_number_[i])] = i;
  }
  std::iota(patch_.begin(), patch_.end(), 0);
  coarse_ = make_coarse_grid(rest_);
  stand_at_rest();
  region_.whole(extent_);
  limit_models();
}

template <typename Real>
void StateWithSensitivities<Real>::limit_models() noexcept {
  for (const auto& model : models_) {
    model->limit(extent_);
  }
}

template <typename Real>
void StateWithSensitivities<Real>::invert_coarse() {
  if (coarse_.place.empty()) {
    return;
  }
  Eigen::MatrixXf stiffness = begin_coarse(coarse_);
  for (const auto& model : models_) {
    model->add_coarse_stiffness(free_, coarse_, stiffness);
  }
  finish_coarse(stiffness, vertex_force_, free_, coarse_);
}

template <typename Real>
Eigen::Vector3d StateWithSensitivities<Real>::position(std::size_t i) const noexcept {
  if constexpr (kDouble) {
    return kernels::to_vector(position_[i]);
  } else {
    return kernels::position_of(state_[i]);
  }
}

template <typename Real>
void StateWithSensitivities<Real>::set_position(std::size_t i,
                                                const Eigen::Vector3d& position) noexcept {
  if constexpr (kDouble) {
    position_[i] = kernels::to_precise(position);
  } else {
    for (int c = 0; c < 3; ++c) {
      state_[i].component[c][0] = static_cast<float>(position[c]);
    }
  }
}

template <typename Real>
Eigen::Vector3d StateWithSensitivities<Real>::standing_position(std::size_t i) const noexcept {
  if (static_cast<std::int32_t>(i) < extent_.reach) {
    return position(i);
  }
  const Eigen::Vector3d way = displacement_ - region_.place(static_cast<std::int32_t>(i));
  return position(i) + sensitivity(i) * way;
}

template <typename Real>
Eigen::Matrix3d StateWithSensitivities<Real>::sensitivity(std::size_t i) const noexcept {
  return kernels::sensitivity_of(state_[i]);
}

template <typename Real>
void StateWithSensitivities<Real>::change_region(int levels) noexcept {
  const std::int32_t reached = extent_.reach;
  region_.set(levels, displacement_, extent_);
  limit_models();
  for (std::int32_t i = reached; i < extent_.reach; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Eigen::Matrix3d s = sensitivity(at);
    const Eigen::Vector3d from = position(at);
    const Eigen::Vector3d& place = region_.place(i);
    set_position(at, from + s * (saved_displacement_ - place));
    saved_state_[at] = state_[at];
    if constexpr (kDouble) {
      saved_position_[at] = position_[at];
    }
    set_position(at, from + s * (displacement_ - place));
    direction_[at] = product_[at] = Lanes{};
  }
  // Nothing corrects S out there, so its trend from when it was solved must not continue.
  for (std::int32_t i = region_.solved_vertices(); i < extent_.reach; ++i) {
    saved_state_[static_cast<std::size_t>(i)] = state_[static_cast<std::size_t>(i)];
  }
  preconditioner_valid_ = false;
}

template <typename Real>
void StateWithSensitivities<Real>::place_patch() noexcept {
  for (std::size_t n = 0; n < patch_.size(); ++n) {
    set_position(static_cast<std::size_t>(patch_[n]), patch_anchor_[n] + displacement_);
  }
  for (std::size_t n = 0; n < others_.size(); ++n) {
    set_position(static_cast<std::size_t>(others_[n]), others_place_[n]);
  }
}

template <typename Real>
void StateWithSensitivities<Real>::advance_to(const Eigen::Vector3d& displacement) noexcept {
  const Eigen::Vector3d step = displacement - displacement_;
  const Eigen::Vector3d last_step = displacement_ - saved_displacement_;
  const Eigen::Vector3f step_m = step.template cast<float>();
  const double trend = last_step.isZero(0.0) ? 0.0 : step.dot(last_step) / last_step.squaredNorm();
  const bool trust = trend_valid_ && std::abs(trend) <= kLargestTrend;
  if constexpr (kDouble) {
    std::copy_n(position_.begin(), extent_.reach, saved_position_.begin());
  }
  kernels::predict(extent_.reach, step_m.data(), trust ? static_cast<float>(trend) : 0.0F,
                   state_.data(), saved_state_.data());
  absorb_correction();
  saved_displacement_ = displacement_;
  displacement_ = displacement;
  trend_valid_ = true;
  place_patch();
}

template <typename Real>
void StateWithSensitivities<Real>::restore() noexcept {
  std::copy_n(saved_state_.begin(), extent_.reach, state_.begin());
  if constexpr (kDouble) {
    std::copy_n(saved_position_.begin(), extent_.reach, position_.begin());
  }
  displacement_ = saved_displacement_;
  forget_trends();
}

template <typename Real>
void StateWithSensitivities<Real>::forget_trends() noexcept {
  trend_valid_ = false;
  // An unstable state may have left numbers here that are not finite; CG begins by multiplying them
  // by zero.
  std::fill(direction_.begin(), direction_.end(), Lanes{});
  std::fill(product_.begin(), product_.end(), Lanes{});
}

template <typename Real>
void StateWithSensitivities<Real>::restore_under_tool() noexcept {
  const Eigen::Vector3d displacement = displacement_;
  restore();
  displacement_ = displacement;
  place_patch();
}

template <typename Real>
void StateWithSensitivities<Real>::begin_at_rest() noexcept {
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    if (is_free(i)) {
      state_[i] = Lanes{};
      set_position(i, rest_[i]);
    }
  }
  forget_trends();
  forget_preconditioner();
}

template <typename Real>
void StateWithSensitivities<Real>::absorb_correction() noexcept {
  if constexpr (kDouble) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(extent_.reach); ++i) {
      for (int c = 0; c < 3; ++c) {
        position_[i].xyz[c] += static_cast<double>(state_[i].component[c][0]);
        state_[i].component[c][0] = 0.0F;
      }
    }
  }
}

// Where the first `count` vertices are, for the models.
template <typename Real>
const typename ForceModel<Real>::Position* StateWithSensitivities<Real>::model_positions(
    std::int32_t count) noexcept {
  if constexpr (kDouble) {
    return position_.data();
  } else {
    kernels::take_positions(count, state_.data(), single_position_.data());
    return single_position_.data();
  }
}

template <typename Real>
double StateWithSensitivities<Real>::energy_J() noexcept {
  double sum_J = 0.0;
  const auto* const positions = model_positions(static_cast<std::int32_t>(rest_.size()));
  for (const auto& model : models_) {
    sum_J += model->energy_J(positions);
  }
  for (std::size_t i = 0; i < vertex_force_.size(); ++i) {
    const kernels::VertexForce& force = vertex_force_[i];
    const Eigen::Vector3d from_home = position(i) - rest_[i];
    sum_J += 0.5 * static_cast<double>(force.home_stiffness_N_per_m) * from_home.squaredNorm() -
             Eigen::Map<const Eigen::Vector3d>(force.load_N).dot(from_home);
  }
  return sum_J;
}

template <typename Real>
void StateWithSensitivities<Real>::save() noexcept {
  std::copy(state_.begin(), state_.end(), saved_state_.begin());
  if constexpr (kDouble) {
    std::copy(position_.begin(), position_.end(), saved_position_.begin());
  }
}

template <typename Real>
Eigen::Vector3d StateWithSensitivities<Real>::saved_position(std::size_t i) const noexcept {
  if constexpr (kDouble) {
    return kernels::to_vector(saved_position_[i]);
  } else {
    return kernels::position_of(saved_state_[i]);
  }
}

template <typename Real>
void StateWithSensitivities<Real>::take_correction(
    bool from_direction, std::vector<Eigen::Vector3f>& correction) noexcept {
  for (std::size_t i = 0; i < rest_.size(); ++i) {
    for (int c = 0; c < 3; ++c) {
      float move = 0.0F;
      if (from_direction) {
        move = direction_[i].component[c][0];
      } else if constexpr (kDouble) {
        move = state_[i].component[c][0];
      } else {
        move = state_[i].component[c][0] - saved_state_[i].component[c][0];
      }
      correction[i][c] = move;
    }
  }
  std::copy(saved_state_.begin(), saved_state_.end(), state_.begin());
}

template <typename Real>
std::span<const kernels::VertexForce> StateWithSensitivities<Real>::active_forces() const noexcept {
  return vertex_force_.empty()
             ? std::span<const kernels::VertexForce>{}
             : std::span(vertex_force_).first(static_cast<std::size_t>(extent_.active));
}

template <typename Real>
void StateWithSensitivities<Real>::update_preconditioner() noexcept {
  if (preconditioner_valid_ &&
      (displacement_ - preconditioner_displacement_).norm() <= kPreconditionerReach_m) {
    return;
  }
  std::fill_n(inverse_.begin(), extent_.reach, kernels::BlockInverse{});
  for (const auto& model : models_) {
    model->add_blocks(inverse_.data());
  }
  kernels::add_home_blocks(active_forces(), inverse_.data());
  const auto solved = static_cast<std::size_t>(region_.solved_vertices());
  for (std::size_t i = 0; i < static_cast<std::size_t>(extent_.reach); ++i) {
    kernels::invert_block(inverse_[i], free_[i] != 0 && i < solved);
  }
  preconditioner_displacement_ = displacement_;
  preconditioner_valid_ = true;
}

template <typename Real>
Evaluation StateWithSensitivities<Real>::evaluate() noexcept {
  const auto* const positions = model_positions(extent_.reach);
  kernels::Precise* const force = kDouble ? force_.data() : nullptr;
  std::fill_n(residual_.begin(), extent_.reach, Lanes{});
  if constexpr (kDouble) {
    std::fill_n(force_.begin(), extent_.reach, kernels::Precise{});
  }
  for (const auto& model : models_) {
    model->evaluate(state_.data(), positions, force, residual_.data());
  }
  if constexpr (kDouble) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(extent_.active); ++i) {
      for (int c = 0; c < 3; ++c) {
        residual_[i].component[c][0] = static_cast<float>(force_[i].xyz[c]);
      }
    }
    kernels::add_vertex_forces(active_forces(), state_.data(), position_.data(), force_.data(),
                               residual_.data());
  } else {
    kernels::add_vertex_forces(active_forces(), state_.data(), residual_.data());
  }
  update_preconditioner();
  const kernels::StateSums sums =
      kernels::summarise(extent_.active, inverse_.data(), state_.data(), residual_.data(), force);
  Evaluation found;
  for (const std::int32_t i : patch_) {
    const auto at = static_cast<std::size_t>(i);
    Eigen::Vector3d pull_N;
    for (int c = 0; c < 3; ++c) {
      if constexpr (kDouble) {
        pull_N[c] = force_[at].xyz[c];
      } else {
        pull_N[c] = static_cast<double>(residual_[at].component[c][0]);
      }
    }
    found.raw_force_W += pull_N;
    found.patch_moment_W_Nm += position(at) * pull_N.transpose();
  }
  double sensitivity_squared = 0.0;
  for (int j = 0; j < 3; ++j) {
    found.force_W[j] = sums.force_N[j];
    sensitivity_squared += sums.sensitivity_squared[j];
    for (int k = 0; k < 3; ++k) {
      found.stiffness_W(j, k) = sums.stiffness_N_per_m[j][k];
    }
  }
  found.residual_N = std::sqrt(sums.residual_squared_N2);
  found.sensitivity_residual_N_per_m = std::sqrt(sensitivity_squared);
  found.border_work_N = silence_border();
  for (std::size_t n = 0; n < constrained_.size(); ++n) {
    const auto at = static_cast<std::size_t>(constrained_[n]);
    pull_[n] = std::exchange(residual_[at], Lanes{});
  }
  return found;
}

template <typename Real>
Eigen::Matrix3d StateWithSensitivities<Real>::mixed_stiffness(
    const StateWithSensitivities& other) const noexcept {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  const auto add = [this, &sum](std::size_t i, const Lanes& pull) {
    for (int c = 0; c < 3; ++c) {
      for (int j = 0; j < 3; ++j) {
        for (int k = 0; k < 3; ++k) {
          sum(j, k) += static_cast<double>(state_[i].component[c][1 + j]) *
                       static_cast<double>(pull.component[c][1 + k]);
        }
      }
    }
  };
  for (std::size_t i = 0; i < state_.size(); ++i) {
    add(i, other.residual_[i]);
  }
  for (std::size_t n = 0; n < other.constrained_.size(); ++n) {
    add(static_cast<std::size_t>(other.constrained_[n]), other.pull_[n]);
  }
  return sum;
}

// The ring outside the region is evaluated, but not solved.
template <typename Real>
double StateWithSensitivities<Real>::silence_border() noexcept {
  double border_work_N = 0.0;
  for (std::int32_t i = region_.solved_vertices(); i < extent_.reach; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (i < extent_.active && free_[at] != 0) {
      Eigen::Vector3d residual_N;
      for (int c = 0; c < 3; ++c) {
        residual_N[c] = static_cast<double>(residual_[at].component[c][0]);
      }
      border_work_N += (sensitivity(at).transpose() * residual_N).norm();
    }
    residual_[at] = Lanes{};
  }
  return border_work_N;
}

// The vertices' half of the preconditioner; what it finds is enough to see whether to go on.
template <typename Real>
kernels::StepSums StateWithSensitivities<Real>::take_step(Float4 alpha) noexcept {
  return kernels::take_step(extent_.reach, alpha, inverse_.data(), no_coarse_, direction_.data(),
                            state_.data(), residual_.data(), product_.data(), nullptr);
}

// The coarse half: what it adds to residual . M residual.
template <typename Real>
Float4 StateWithSensitivities<Real>::precondition_coarsely() noexcept {
  kernels::restrict_residual(coarse(), residual_.data(), coarse_residual_.data());
  return kernels::solve_coarse(coarse(), coarse_residual_.data(), coarse_correction_.data());
}

template <typename Real>
void StateWithSensitivities<Real>::next_direction(Float4 beta,
                                                  const kernels::CoarseGrid& coarse) noexcept {
  kernels::next_direction(extent_.reach, beta, inverse_.data(), coarse, coarse_correction_.data(),
                          direction_.data(), product_.data());
}

// product += K direction; the last model's dot products are those of all.
template <typename Real>
Float4 StateWithSensitivities<Real>::apply_stiffness() noexcept {
  const float* const home_N_per_m = home_N_per_m_.empty() ? nullptr : home_N_per_m_.data();
  Float4 curvature{};
  for (const auto& model : models_) {
    curvature = model->apply_stiffness(model == models_.back() ? home_N_per_m : nullptr,
                                       direction_.data(), product_.data());
  }
  return curvature;
}

template <typename Real>
Descent StateWithSensitivities<Real>::descend(int max_iterations, double residual_aim_N,
                                              double sensitivity_aim_N_per_m) noexcept {
  Descent result;
  const bool has_coarse = !coarse().place.empty();
  const Float4 zero{};
  const Float4 first =
      kernels::precondition(extent_.reach, inverse_.data(), residual_.data(), product_.data()) +
      precondition_coarsely();
  next_direction(zero, coarse());
  Float4 before = first;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    const Float4 curvature = apply_stiffness();
    Float4 alpha{};
    bool active = false;
    for (int lane = 0; lane < 4; ++lane) {
      if (!(before[lane] > first[lane] * static_cast<float>(kFinishedLane))) {
        continue;
      }
      if (!(curvature[lane] > 0.0F)) {
        result.unstable = true;
        return result;
      }
      alpha[lane] = before[lane] / curvature[lane];
      active = true;
    }
    if (!active) {
      return result;
    }
    const kernels::StepSums sums = take_step(alpha);
    ++result.iterations;
    const double sensitivity_N_per_m =
        std::sqrt(static_cast<double>(sums.squared[1]) + static_cast<double>(sums.squared[2]) +
                  static_cast<double>(sums.squared[3]));
    const double residual_N = std::sqrt(static_cast<double>(sums.squared[0]));
    if (!std::isfinite(residual_N) || !std::isfinite(sensitivity_N_per_m)) {
      result.unstable = true;
      return result;
    }
    if ((residual_N <= residual_aim_N && sensitivity_N_per_m <= sensitivity_aim_N_per_m) ||
        result.iterations == max_iterations) {
      return result;
    }
    // Polak and Ribiere's formula, since the preconditioner has changed since the last direction.
    // Where it changes back, the directions start again.
    const bool coarsely = has_coarse && result.iterations >= kIterationsWithoutCoarse;
    const bool anew = has_coarse && result.iterations == kIterationsWithoutCoarse;
    const Float4 preconditioned =
        coarsely ? sums.preconditioned + precondition_coarsely() : sums.preconditioned;
    const Float4 change = coarsely ? preconditioned : preconditioned - sums.former;
    Float4 beta{};
    for (int lane = 0; lane < 4; ++lane) {
      beta[lane] = before[lane] > 0.0F && !anew ? change[lane] / before[lane] : 0.0F;
    }
    before = preconditioned;
    next_direction(beta, coarsely ? coarse() : no_coarse_);
  }
  return result;
}

template class StateWithSensitivities<float>;
template class StateWithSensitivities<double>;

}  // namespace forcegrid::simulator
