// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace forcegrid::servo {

struct CouplingOptions {
  double stiffness_N_per_m = 1000.0;
  double damping_N_s_per_m = 10.0;
};

/// A spring and damper between the tool P and a massless proxy Q that touches the object in its
/// place (Colgate, Stanley and Brown, IROS 1995; Adams and Hannaford, IEEE Trans. Robotics and
/// Automation 15(3), 1999). The force F(Q) of the object on the proxy is the force on the hand, and
///
///   b d(Q - P)/dt + k (Q - P) = F(Q)
///
/// by backward Euler. At rest the object and the coupling are springs in series: a stiffness K is
/// rendered as K k / (K + k). That is a relative force error of K / (K + k) with any method, so the
/// coupling is off by default.
///
/// Real-time: no allocation, lock or throw. Threads: one.
class VirtualCoupling {
 public:
  /// @throws std::invalid_argument unless stiffness k and damping b are above zero.
  explicit VirtualCoupling(const CouplingOptions& options = {});

  /// [m] Q for a tool at `position_W`: where the methods are evaluated.
  Eigen::Vector3d proxy_W(const Eigen::Vector3d& position_W) const noexcept {
    return position_W + deflection_W_;
  }

  /// @param dt_s [s] for which `force_W` acts. @param force_W [N] of the object on the proxy;
  /// ignored if not finite.
  void advance(double dt_s, const Eigen::Vector3d& force_W) noexcept;

  /// Puts the proxy where the tool is.
  void reset() noexcept { deflection_W_.setZero(); }

 private:
  CouplingOptions options_;
  Eigen::Vector3d deflection_W_ = Eigen::Vector3d::Zero();  ///< [m] Q - P
};

}  // namespace forcegrid::servo
