// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "stability/virtual_object.h"

namespace forcegrid::stability {

/// A block of 60 x 60 x 30 mm that moves by itself: 196 equal masses, 0.3 kg in all, in a lattice
/// of springs along its cells' edges, face and body diagonals, each with a damper of damping time
/// tau (force k (d + tau d')); the bottom stands still, and the tool holds 3 x 3 masses of the
/// top's middle. Small displacements:
///
///   M q'' + tau K q' + K q = -K_t (u + tau u'),    F = -(K_tt (u + tau u') + K_t^T (q + tau q'))
///
/// with q the displacements of the free masses and u that of the tool. The rate of u is taken over
/// 5 ms, because the tool's position is known only in encoder counts. M is a multiple of the
/// identity and the damping a multiple of K, so the eigenvectors of K decouple the equations; each
/// is stepped linearly implicitly by 1 ms. At rest the object is a spring of the given stiffness
/// along z. at() returns the stiffness at rest. Source: Bathe, Finite Element Procedures (1996),
/// 9.3 (mode superposition, damping proportional to stiffness).
class DynamicObject final : public VirtualObject {
 public:
  static constexpr double kMass_kg = 0.3;
  static constexpr double kStep_s = 1e-3;
  static constexpr double kRateOver_s = 5e-3;

  DynamicObject(double stiffness_N_per_m, const Eigen::Vector3d& contact_point_W,
                double damping_time_s);

  void advance(double time_s, const Eigen::Vector3d& position_W) override;
  Value at(const Eigen::Vector3d& position_W) const override;
  Contact contact() const override { return {true, 1, contact_point_W_}; }
  double stiffness_N_per_m() const noexcept override { return stiffness_N_per_m_; }

  /// [s] Undamped period of the slowest mode while the tool holds still.
  double slowest_period_s() const;

 private:
  Eigen::Vector3d rate_W(const Eigen::Vector3d& displacement_W) const {
    return (displacement_W - lately_W_) / kRateOver_s;
  }
  void step(const Eigen::Vector3d& displacement_W);

  double stiffness_N_per_m_;
  Eigen::Vector3d contact_point_W_;
  double damping_time_s_;
  double scale_;  ///< of a lattice whose springs have 1 N/m
  Eigen::ArrayXd modes_m_;
  Eigen::ArrayXd rates_m_per_s_;
  Eigen::Vector3d lately_W_ = Eigen::Vector3d::Zero();  ///< the tool's displacement, low-passed
  Eigen::Vector3d last_W_ = Eigen::Vector3d::Zero();
  double last_s_ = 0.0;
};

}  // namespace forcegrid::stability
