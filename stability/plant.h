// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "stability/hand.h"

namespace forcegrid::stability {

/// A device reduced to its tip: the same mass and friction in every direction. The default is the
/// equivalent device of the method study.
struct DeviceDynamics {
  double mass_kg = 0.06;
  double damping_N_s_per_m = 0.3;
  double coulomb_friction_N = 0.0;  ///< against the direction of motion
  double position_step_m = 23e-6;   ///< of the encoders, at the tip; 0: not quantised
  double max_force_N = 7.9;         ///< of the motors, at the tip; infinite: no limit
};

/// Device and hand as one mass, in simulated time:
///
///   (m_d + m_h) x'' = F_motor + k (r - x) + b_h (r' - x') - b_d x' - f_c x'/|x'|
///
/// with the hand's target r moving at constant speed within a step. The linear part advances by its
/// matrix exponential, so steps of any length are exact. Coulomb friction advances in substeps of
/// kFrictionStep_s and can only brake. Source of the exact step: Franklin, Powell and Workman,
/// Digital Control of Dynamic Systems, 3rd ed. (1998), section 4.3. Threads: one.
class Plant {
 public:
  static constexpr double kFrictionStep_s = 125e-6;

  /// Starts at rest at `start_W` [m], with the hand's target at the same place.
  /// @throws std::invalid_argument for a mass that is not positive, or a negative parameter.
  Plant(const DeviceDynamics& device, const Hand& hand, const Eigen::Vector3d& start_W);

  /// Advances by `duration_ns` [ns] with a constant motor force [N], which is not limited here; the
  /// target moves from its position to `target_W` [m].
  void advance(std::int64_t duration_ns, const Eigen::Vector3d& motor_force_W,
               const Eigen::Vector3d& target_W);

  /// Applies the impulse `impulse_W` [N s] instantly.
  void flick(const Eigen::Vector3d& impulse_W) noexcept;

  const Eigen::Vector3d& position_W() const noexcept { return position_W_; }  ///< [m]
  const Eigen::Vector3d& velocity_W() const noexcept { return velocity_W_; }  ///< [m/s]
  const Eigen::Vector3d& target_W() const noexcept { return target_W_; }      ///< [m]
  double moving_mass_kg() const noexcept { return mass_kg_; }

  /// [m] `position_W` as measured by the encoders.
  Eigen::Vector3d measured_W(const Eigen::Vector3d& position_W) const noexcept;

 private:
  // e = x - r:  (e, e')(t + h) = transition (e, e')(t) + response u
  struct Step {
    std::int64_t duration_ns;
    Eigen::Matrix2d transition;
    Eigen::Vector2d response;
  };
  const Step& step_of(std::int64_t duration_ns);
  void linear_step(const Step& step, double duration_s, const Eigen::Vector3d& motor_force_W,
                   const Eigen::Vector3d& target_W, const Eigen::Vector3d& target_speed_W) noexcept;

  DeviceDynamics device_;
  double mass_kg_;
  double damping_N_s_per_m_;
  double stiffness_N_per_m_;
  std::vector<Step> steps_;
  Eigen::Vector3d position_W_;
  Eigen::Vector3d velocity_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_W_;
};

}  // namespace forcegrid::stability
