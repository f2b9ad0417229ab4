// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/reduced_model.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

namespace forcegrid::simulator {
namespace {

constexpr int kMostNewtonSteps = 8;
constexpr double kGapTolerance = 1e-3;
constexpr double kForceFloor_N = 0.05;
// A longer move starts from the nearest state of the training.
constexpr double kLongMove_m = 5e-3;

}  // namespace

ReducedModel::ReducedModel(Parts parts)
    : parts_(std::move(parts)), modes_(parts_.springs.coordinates() - 3) {
  assert(modes_ >= 0 && parts_.linear_stiffness.rows() == modes_ + 3);
  assert(parts_.trained_amplitudes.rows() == modes_ || parts_.trained_at_W.empty());
  z_.setZero(modes_ + 3);
  follow_.setZero(modes_, 3);
}

std::size_t ReducedModel::memory_bytes() const noexcept {
  const auto doubles = parts_.linear_stiffness.size() + parts_.rest_force.size() +
                       parts_.trained_amplitudes.size() + z_.size();
  return sizeof *this + parts_.springs.memory_bytes() +
         parts_.trained_at_W.capacity() * sizeof(Eigen::Vector3d) +
         static_cast<std::size_t>(doubles) * sizeof(double);
}

double ReducedModel::distance_m(const Eigen::Vector3d& displacement_W) const noexcept {
  double nearest2 = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3d& at_W : parts_.trained_at_W) {
    nearest2 = std::min(nearest2, (at_W - displacement_W).squaredNorm());
  }
  return std::sqrt(nearest2);
}

void ReducedModel::start_near(const Eigen::Vector3d& displacement_W) noexcept {
  z_.setZero();
  follow_.setZero();
  double nearest2 = displacement_W.squaredNorm();  // at rest q = 0
  for (std::size_t k = 0; k < parts_.trained_at_W.size(); ++k) {
    const double distance2 = (parts_.trained_at_W[k] - displacement_W).squaredNorm();
    if (distance2 < nearest2) {
      nearest2 = distance2;
      z_.head<3>() = parts_.trained_at_W[k];
      z_.tail(modes_) = parts_.trained_amplitudes.col(static_cast<Eigen::Index>(k));
    }
  }
}

bool ReducedModel::take_newton_step(Equilibrium& answer) noexcept {
  const int n = modes_ + 3;
  Coordinates force(n);
  Square stiffness(n, n);
  parts_.springs.evaluate(z_.data(), force.data(), stiffness.data());
  force += parts_.rest_force;
  force.noalias() -= parts_.linear_stiffness.lazyProduct(z_);
  stiffness += parts_.linear_stiffness;
  ++answer.evaluations;
  answer.raw_force_W = force.head<3>();
  answer.force_W = answer.raw_force_W;
  answer.stiffness_W = -stiffness.topLeftCorner<3, 3>();
  if (modes_ > 0) {
    const Square inner = stiffness.bottomRightCorner(modes_, modes_);
    const Eigen::LLT<Square> factor(inner);
    if (factor.info() != Eigen::Success || !force.allFinite()) {
      return false;
    }
    follow_ = -stiffness.bottomLeftCorner(modes_, 3);
    factor.solveInPlace(follow_);
    const Coordinates residual = force.tail(modes_);
    answer.force_W += follow_.transpose().lazyProduct(residual);
    answer.stiffness_W -= stiffness.topRightCorner(3, modes_).lazyProduct(follow_);
    z_.tail(modes_) += factor.solve(residual);
    ++answer.iterations;
  }
  answer.force_gap_N = (answer.force_W - answer.raw_force_W).norm();
  return answer.force_W.allFinite() && answer.stiffness_W.allFinite() && z_.allFinite();
}

Equilibrium ReducedModel::move_to(const Eigen::Vector3d& displacement_W) noexcept {
  const auto start = std::chrono::steady_clock::now();
  Equilibrium answer;
  if (!displacement_W.allFinite()) {
    answer.displacement_W = z_.head<3>();
    answer.reached = false;
    return answer;
  }
  if (!started_ || (displacement_W - z_.head<3>()).norm() > kLongMove_m) {
    start_near(displacement_W);
  }
  const Eigen::Vector3d step_W = displacement_W - z_.head<3>();
  z_.tail(modes_) += follow_.lazyProduct(step_W);
  z_.head<3>() = displacement_W;
  answer.displacement_W = displacement_W;
  answer.steps = 1;
  started_ = false;
  for (int k = 0; k < kMostNewtonSteps && take_newton_step(answer); ++k) {
    const double scale_N = std::max(answer.force_W.norm(), kForceFloor_N);
    answer.relative_residual = answer.force_gap_N / scale_N;
    if (answer.relative_residual <= kGapTolerance) {
      answer.converged = started_ = true;
      break;
    }
  }
  answer.vertices = static_cast<int>(springs());
  answer.solve_time_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return answer;
}

}  // namespace forcegrid::simulator
