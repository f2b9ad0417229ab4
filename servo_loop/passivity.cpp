// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/passivity.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "servo_loop/dead_band.h"

namespace forcegrid::servo {
namespace {

// Times of what the arm's damping takes, at which nothing of the sampling's energy is left to it.
constexpr double kSlowNoneAt = 2.0;
constexpr double kFastNoneAt = 1.25;
// A loop that swings bears a little less holding and delay than energy alone allows: quantisation
// and a stiffness that is not known exactly swing it as well.
constexpr double kHoldMargin = 1.1;
constexpr double kDelayMargin = 1.5;

/// Of a sampling's energy, the part that is left to the arm's damping: all of what is not more than
/// that bears, none of what is `none_at` times as much.
double share_borne(double bearable_J, double sampling_J, double none_at) noexcept {
  return sampling_J > 0.0
             ? std::clamp((none_at * bearable_J / sampling_J - 1.0) / (none_at - 1.0), 0.0, 1.0)
             : 0.0;
}

/// The damping that takes `excess_J` out within one cycle, at most `max_N_s_per_m`.
double damping(double excess_J, double max_N_s_per_m, double dt_s,
               double speed_squared_m2_per_s2) noexcept {
  const double per_damping_J = dt_s * speed_squared_m2_per_s2;
  return excess_J >= max_N_s_per_m * per_damping_J ? max_N_s_per_m : excess_J / per_damping_J;
}

}  // namespace

PassivityGuard::PassivityGuard(const PassivityOptions& options) : options_(options) {
  if (!(options.allowance_J >= 0.0) || !(options.bound_J > options.allowance_J) ||
      !std::isfinite(options.bound_J)) {
    throw std::invalid_argument(
        "passivity: the energy allowance must not be negative, and the bound above it");
  }
  if (!(options.max_damping_N_s_per_m >= 0.0) || !std::isfinite(options.max_damping_N_s_per_m)) {
    throw std::invalid_argument("passivity: the largest damping must not be negative");
  }
  if (!(options.arm_damping_N_s_per_m >= 0.0) || !std::isfinite(options.arm_damping_N_s_per_m)) {
    throw std::invalid_argument("passivity: the arm's damping must not be negative");
  }
  if (!(options.transport_delay_s >= 0.0) || !std::isfinite(options.transport_delay_s)) {
    throw std::invalid_argument("passivity: the transport delay must not be negative");
  }
  if (!(options.moving_mass_kg > 0.0) || !std::isfinite(options.moving_mass_kg)) {
    throw std::invalid_argument("passivity: the moving mass must be positive");
  }
  if (!(options.velocity_time_constant_s > 0.0) ||
      !std::isfinite(options.velocity_time_constant_s)) {
    throw std::invalid_argument("passivity: the velocity's time constant must be positive");
  }
  if (!(options.dead_band_counts >= 0.0) || !std::isfinite(options.dead_band_counts)) {
    throw std::invalid_argument("passivity: the dead band must not be negative");
  }
}

Eigen::Vector3d PassivityGuard::apply(double dt_s, const Eigen::Vector3d& position_W,
                                      const Eigen::Vector3d& wanted_W) noexcept {
  if (!position_W.allFinite() || !wanted_W.allFinite() || !std::isfinite(dt_s)) {
    restart();
    return wanted_W;
  }
  const bool counts = has_last_ && dt_s > 0.0;
  const Eigen::Vector3d step_W =
      counts ? Eigen::Vector3d(position_W - last_position_W_) : Eigen::Vector3d::Zero();
  Eigen::Vector3d force_W = wanted_W;
  damping_N_s_per_m_ = 0.0;
  if (counts) {
    observe(dt_s, step_W, wanted_W);
    const double share = 1.0 - std::exp(-dt_s / options_.velocity_time_constant_s);
    velocity_W_ += share * (step_W / dt_s - velocity_W_);
    slow_velocity_W_ += (1.0 - std::exp(-dt_s / kSlow_s)) * (step_W / dt_s - slow_velocity_W_);
    if (options_.mode == PassivityMode::kControl) {
      shorten(dt_s, step_W, wanted_W);
      force_W = scale_ * wanted_W + damp(dt_s);
    }
  }
  has_last_ = true;
  last_position_W_ = position_W;
  last_wanted_W_ = wanted_W;
  rendered_W_ = force_W;
  return force_W;
}

void PassivityGuard::observe(double dt_s, const Eigen::Vector3d& step_W,
                             const Eigen::Vector3d& wanted_W) noexcept {
  const Eigen::Array3d rounding_m = (step_W - dt_s * velocity_W_)
                                        .array()
                                        .max(-resolution_W_m_.array())
                                        .min(resolution_W_m_.array());
  const Eigen::Array3d change_N = (wanted_W - last_wanted_W_).array();
  const Eigen::Array3d given_J = rendered_W_.array() * step_W.array() + 0.5 * rounding_m * change_N;
  energy_W_J_ += given_J.matrix();
  total_J_ += given_J.sum();
  largest_J_ = std::max(largest_J_, energy_to_hand_J());

  const Eigen::Array3d motion_m = step_W.array() - rounding_m;
  const Eigen::Array3d slow_m = dt_s * slow_velocity_W_.array();
  const Eigen::Array3d slow_J = -0.5 * slow_m * change_N;
  const Eigen::Array3d fast_J = -0.5 * (motion_m - slow_m) * change_N;
  const double bearable_J =
      options_.arm_damping_N_s_per_m * (motion_m * step_W.array()).sum() / dt_s;
  const double sampling_J = std::abs((slow_J + fast_J).sum());
  // What a late force gives beyond what the positions show, as a part of what they show.
  const double late = fast_J.sum() > 0.0 ? 2.0 * options_.transport_delay_s / dt_s : 0.0;
  const double slow_borne = share_borne(bearable_J, sampling_J, kSlowNoneAt);
  const double fast_borne =
      share_borne(bearable_J, (kHoldMargin + kDelayMargin * late) * sampling_J, kFastNoneAt);
  account_W_J_ +=
      (given_J - slow_borne * slow_J + (late - fast_borne * (1.0 + late)) * fast_J).matrix();
}

void PassivityGuard::open_account() noexcept {
  energy_W_J_.setZero();
  account_W_J_.setZero();
}

void PassivityGuard::grant(double energy_J) noexcept {
  const double debt_J = account_J();
  if (debt_J > 0.0) {
    account_W_J_ *= std::max(0.0, debt_J - energy_J) / debt_J;
  }
}

Eigen::Vector3d PassivityGuard::motion_W() const noexcept {
  return without_trembling_counts(velocity_W_, resolution_W_m_, options_.dead_band_counts,
                                  options_.velocity_time_constant_s);
}

Eigen::Vector3d PassivityGuard::damp(double dt_s) noexcept {
  const Eigen::Vector3d moving = motion_W();
  Eigen::Array3d damping_N_s_per_m = Eigen::Array3d::Zero();
  if (options_.each_axis) {
    for (Eigen::Index i = 0; i < 3; ++i) {
      const double excess_J = account_W_J_[i] + owed_J_ - options_.allowance_J;
      if (excess_J > 0.0 && moving[i] != 0.0) {
        damping_N_s_per_m[i] =
            damping(excess_J, options_.max_damping_N_s_per_m, dt_s, moving[i] * velocity_W_[i]);
      }
    }
  } else {
    const double excess_J = account_J() + owed_J_ - options_.allowance_J;
    if (excess_J > 0.0 && !moving.isZero(0.0)) {
      damping_N_s_per_m.setConstant(
          damping(excess_J, options_.max_damping_N_s_per_m, dt_s, moving.dot(velocity_W_)));
    }
  }
  damping_N_s_per_m_ = damping_N_s_per_m.maxCoeff();
  const Eigen::Vector3d force_W = -(damping_N_s_per_m * moving.array()).matrix();
  damped_J_ -= dt_s * force_W.dot(velocity_W_);
  return force_W;
}

void PassivityGuard::shorten(double dt_s, const Eigen::Vector3d& step_W,
                             const Eigen::Vector3d& wanted_W) noexcept {
  find_stiffness(dt_s, step_W, wanted_W);
  const double left_J = std::max(0.0, options_.bound_J - account_J());
  const double before_J = energy_before_the_tool_J(wanted_W);
  const double most = before_J > left_J ? left_J / before_J : 1.0;
  const double risen = std::max(scale_, std::min(most, scale_ + dt_s / kRecovery_s));
  scale_ = std::min({allowed_scale(dt_s, step_W, wanted_W, left_J), 1.0, risen});
  owed_J_ = scale_ < 1.0 ? before_J : 0.0;
}

double PassivityGuard::allowed_scale(double dt_s, const Eigen::Vector3d& step_W,
                                     const Eigen::Vector3d& wanted_W,
                                     double left_J) const noexcept {
  // What s times the wanted force gives within the horizon is s linear + s^2 square. The filtered
  // velocity is late, the raw one is coarse: what gives more counts.
  const double horizon_s = kBoundCycles * dt_s + options_.transport_delay_s;
  const double linear_J =
      horizon_s * std::max(wanted_W.dot(velocity_W_), wanted_W.dot(step_W) / dt_s);
  const double square_J =
      0.5 * wanted_W.squaredNorm() * horizon_s * horizon_s / options_.moving_mass_kg;
  if (linear_J + square_J <= left_J) {
    return 1.0;
  }
  const double root_J = std::sqrt(linear_J * linear_J + 4.0 * square_J * left_J);
  return linear_J > 0.0 ? 2.0 * left_J / (linear_J + root_J)
                        : (root_J - linear_J) / (2.0 * square_J);
}

void PassivityGuard::find_stiffness(double dt_s, const Eigen::Vector3d& step_W,
                                    const Eigen::Vector3d& wanted_W) noexcept {
  if (step_W.isZero(0.0)) {
    return;  // a tool at rest says nothing of it, and nothing is forgotten meanwhile
  }
  const double kept = std::exp(-dt_s / kSlow_s);
  resisted_J_ = kept * resisted_J_ - step_W.dot(wanted_W - last_wanted_W_);
  moved_m2_ = kept * moved_m2_ + step_W.squaredNorm();
}

double PassivityGuard::energy_before_the_tool_J(const Eigen::Vector3d& wanted_W) const noexcept {
  const double size_N = wanted_W.norm();
  const double constant_J = size_N * kReach_m;
  return 2.0 * resisted_J_ * constant_J > size_N * size_N * moved_m2_
             ? size_N * size_N * moved_m2_ / (2.0 * resisted_J_)
             : constant_J;
}

void PassivityGuard::restart() noexcept {
  has_last_ = false;
  rendered_W_.setZero();
  last_wanted_W_.setZero();
  velocity_W_.setZero();
  slow_velocity_W_.setZero();
  resisted_J_ = 0.0;
  moved_m2_ = 0.0;
}

}  // namespace forcegrid::servo
