// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/turning_sensitivities.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "simulator/solver/cross_matrix.h"

namespace forcegrid::simulator {
namespace {

constexpr int kMaxTurningRounds = 4;
constexpr double kTurningAimBelowTolerance = 0.5;

}  // namespace

template <typename Real>
void TurningSensitivities<Real>::hold(const State& lead, const Eigen::Vector3d& pivot,
                                      const std::vector<std::int32_t>& others) {
  pivot_ = pivot;
  patch_ = lead.patch();
  arm_.clear();
  reach_m_ = 0.0;
  for (const std::int32_t i : patch_) {
    arm_.push_back(lead.position(static_cast<std::size_t>(i)) - pivot);
    reach_m_ = std::max(reach_m_, arm_.back().norm());
  }
  anchor_.resize(arm_.size());
  take_hold(lead, others, true);
}

template <typename Real>
void TurningSensitivities<Real>::share(const State& lead, const std::vector<std::int32_t>& others) {
  take_hold(lead, others, false);
}

template <typename Real>
void TurningSensitivities<Real>::take_hold(const State& lead,
                                           const std::vector<std::int32_t>& others, bool anew) {
  // Held, but not by a displacement: its own places and sensitivities are set each time.
  std::vector<std::int32_t> held = patch_;
  held.insert(held.end(), others.begin(), others.end());
  state_.share({}, {}, std::move(held), anew);
  follow(lead, pivot_ + lead.displacement_W());
  static_cast<void>(state_.evaluate());
  state_.invert_coarse();
}

template <typename Real>
void TurningSensitivities<Real>::release() noexcept {
  patch_.clear();
  arm_.clear();
  state_.release();
}

template <typename Real>
std::size_t TurningSensitivities<Real>::memory_bytes() const noexcept {
  return sizeof *this - sizeof state_ + state_.memory_bytes() +
         patch_.capacity() * sizeof(std::int32_t) +
         (arm_.capacity() + anchor_.capacity()) * sizeof(Eigen::Vector3d);
}

template <typename Real>
const std::vector<Eigen::Vector3d>& TurningSensitivities<Real>::anchor(
    const Eigen::Quaterniond& turn_W) noexcept {
  for (std::size_t n = 0; n < arm_.size(); ++n) {
    anchor_[n] = pivot_ + turn_W * arm_[n];
  }
  return anchor_;
}

template <typename Real>
void TurningSensitivities<Real>::predict(const Eigen::Vector3d& theta_W_rad,
                                         State& lead) const noexcept {
  for (std::size_t i = 0; i < lead.vertex_count(); ++i) {
    if (lead.is_free(i)) {
      lead.set_position(i, lead.position(i) + state_.sensitivity(i) * theta_W_rad);
    }
  }
}

template <typename Real>
void TurningSensitivities<Real>::follow(const State& lead, const Eigen::Vector3d& pivot) noexcept {
  for (std::size_t i = 0; i < lead.vertex_count(); ++i) {
    state_.set_position(i, lead.position(i));
  }
  for (const std::int32_t i : patch_) {
    const auto at = static_cast<std::size_t>(i);
    state_.set_sensitivity(at, -cross_matrix(lead.position(at) - pivot));
  }
}

template <typename Real>
typename TurningSensitivities<Real>::Found TurningSensitivities<Real>::solve(
    const State& lead, const Evaluation& at, double tolerance, int max_iterations) noexcept {
  // A turn changes the tangent, too; this is cheap beside the iterations that it saves.
  state_.forget_preconditioner();
  const Eigen::Vector3d pivot = pivot_ + lead.displacement_W();
  const double aim_N_per_rad = tolerance * std::max(at.stiffness_W.norm(), 1e-12) * reach_m_;
  follow(lead, pivot);
  Evaluation evaluation = state_.evaluate();
  Found found;
  bool stable = true;
  for (int round = 0; round < kMaxTurningRounds && stable && evaluation.finite() &&
                      evaluation.sensitivity_residual_N_per_m > aim_N_per_rad;
       ++round) {
    const Descent descent = state_.descend(max_iterations, std::numeric_limits<double>::infinity(),
                                           kTurningAimBelowTolerance * aim_N_per_rad);
    found.iterations += descent.iterations;
    stable = !descent.unstable;
    state_.absorb_correction();
    follow(lead, pivot);  // the positions are the lead's alone to correct
    evaluation = state_.evaluate();
  }
  const Eigen::Matrix3d arms = at.patch_moment_W_Nm - pivot * at.raw_force_W.transpose();
  found.torque_W_Nm = evaluation.force_W;
  found.stiffness_W_Nm_per_rad =
      evaluation.stiffness_W + arms - arms.trace() * Eigen::Matrix3d::Identity();
  found.gradient_W_N = state_.mixed_stiffness(lead);
  found.known = stable && evaluation.finite() && found.stiffness_W_Nm_per_rad.allFinite() &&
                found.gradient_W_N.allFinite();
  return found;
}

template class TurningSensitivities<float>;
template class TurningSensitivities<double>;

}  // namespace forcegrid::simulator
