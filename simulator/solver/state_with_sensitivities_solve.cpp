#include <cmath>

#include "simulator/kernels/kernel_support.h"
#include "simulator/solver/state_with_sensitivities.h"

namespace forcegrid::simulator {
namespace {

using kernels::Float4;
using kernels::Lanes;

// The preconditioner tolerates this much motion before it is worth computing anew.
constexpr double kPreconditionerReach_m = 3e-3;
// The coarse half costs as much as the springs' pass. In the first direction of a correction it
// does most of what it can do; after so many iterations it is worth its time in every one.
constexpr int kIterationsWithoutCoarse = 8;
// Below this fraction of where it began a lane is at single precision's end.
constexpr double kFinishedLane = 1e-13;

}  // namespace

bool Evaluation::finite() const noexcept {
  return std::isfinite(residual_N) && std::isfinite(sensitivity_residual_N_per_m) &&
         force_W.allFinite() && stiffness_W.allFinite();
}

template <typename Real>
std::span<const kernels::VertexForce> StateWithSensitivities<Real>::active_forces() const noexcept {
  return vertex_force_.empty()
             ? std::span<const kernels::VertexForce>{}
             : std::span(vertex_force_).first(static_cast<std::size_t>(rows_.active));
}

template <typename Real>
void StateWithSensitivities<Real>::update_preconditioner() noexcept {
  if (preconditioner_valid_ &&
      (displacement_ - preconditioner_displacement_).norm() <= kPreconditionerReach_m) {
    return;
  }
  kernels::sum_blocks(rows_, tangent_.data(), inverse_.data());
  kernels::add_home_blocks(active_forces(), inverse_.data());
  const auto solved = static_cast<std::size_t>(region_.solved_vertices());
  for (std::size_t i = 0; i < static_cast<std::size_t>(rows_.reach); ++i) {
    kernels::invert_block(inverse_[i], free_[i] != 0 && i < solved);
  }
  preconditioner_displacement_ = displacement_;
  preconditioner_valid_ = true;
}

template <typename Real>
Evaluation StateWithSensitivities<Real>::evaluate() noexcept {
  const kernels::Precise* force = nullptr;
  if constexpr (kDouble) {
    kernels::evaluate(rows_, constants_.data(), exponential_, state_.data(), position_.data(),
                      t_N_per_m_.data(), force_.data(), residual_.data(), tangent_.data());
    kernels::add_vertex_forces(active_forces(), state_.data(), position_.data(), force_.data(),
                               residual_.data());
    force = force_.data();
  } else {
    kernels::evaluate(rows_, constants_.data(), exponential_, state_.data(),
                      single_position_.data(), residual_.data(), tangent_.data());
    kernels::add_vertex_forces(active_forces(), state_.data(), residual_.data());
  }
  update_preconditioner();
  const kernels::StateSums sums =
      kernels::summarise(rows_.active, inverse_.data(), state_.data(), residual_.data(), force);
  Evaluation found;
  for (const std::int32_t i : patch_) {
    const auto at = static_cast<std::size_t>(i);
    for (int c = 0; c < 3; ++c) {
      if constexpr (kDouble) {
        found.raw_force_W[c] += force_[at].xyz[c];
      } else {
        found.raw_force_W[c] += static_cast<double>(residual_[at].component[c][0]);
      }
    }
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
  for (const std::int32_t i : constrained_) {
    residual_[static_cast<std::size_t>(i)] = Lanes{};
  }
  return found;
}

// The ring outside the region is evaluated, but not solved.
template <typename Real>
double StateWithSensitivities<Real>::silence_border() noexcept {
  double border_work_N = 0.0;
  for (std::int32_t i = region_.solved_vertices(); i < rows_.reach; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (i < rows_.active && free_[at] != 0) {
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
  return kernels::take_step(rows_.reach, alpha, inverse_.data(), no_coarse_, direction_.data(),
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
  kernels::next_direction(rows_.reach, beta, inverse_.data(), coarse, coarse_correction_.data(),
                          direction_.data(), product_.data());
}

template <typename Real>
Descent StateWithSensitivities<Real>::descend(int max_iterations, double residual_aim_N,
                                              double sensitivity_aim_N_per_m) noexcept {
  Descent result;
  const bool has_coarse = !coarse().place.empty();
  const Float4 zero{};
  const Float4 first =
      kernels::precondition(rows_.reach, inverse_.data(), residual_.data(), product_.data()) +
      precondition_coarsely();
  next_direction(zero, coarse());
  Float4 before = first;
  const float* const home_N_per_m = home_N_per_m_.empty() ? nullptr : home_N_per_m_.data();
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    const Float4 curvature = kernels::apply_stiffness(rows_, tangent_.data(), home_N_per_m,
                                                      direction_.data(), product_.data());
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
    // Polak and Ribiere's, since the preconditioner has changed since the last direction; where it
    // changes back they begin anew.
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

template std::span<const kernels::VertexForce> StateWithSensitivities<float>::active_forces()
    const noexcept;
template void StateWithSensitivities<float>::update_preconditioner() noexcept;
template Evaluation StateWithSensitivities<float>::evaluate() noexcept;
template double StateWithSensitivities<float>::silence_border() noexcept;
template kernels::StepSums StateWithSensitivities<float>::take_step(Float4) noexcept;
template Float4 StateWithSensitivities<float>::precondition_coarsely() noexcept;
template void StateWithSensitivities<float>::next_direction(Float4,
                                                            const kernels::CoarseGrid&) noexcept;
template Descent StateWithSensitivities<float>::descend(int, double, double) noexcept;
template std::span<const kernels::VertexForce> StateWithSensitivities<double>::active_forces()
    const noexcept;
template void StateWithSensitivities<double>::update_preconditioner() noexcept;
template Evaluation StateWithSensitivities<double>::evaluate() noexcept;
template double StateWithSensitivities<double>::silence_border() noexcept;
template kernels::StepSums StateWithSensitivities<double>::take_step(Float4) noexcept;
template Float4 StateWithSensitivities<double>::precondition_coarsely() noexcept;
template void StateWithSensitivities<double>::next_direction(Float4,
                                                             const kernels::CoarseGrid&) noexcept;
template Descent StateWithSensitivities<double>::descend(int, double, double) noexcept;

}  // namespace forcegrid::simulator
