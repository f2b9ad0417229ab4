// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/simple/contact_model_method.h"

namespace forcegrid {

/// What secant, broyden and tangent share: the newest sample, and a stiffness that extends it.
///
///   F(P) = F_k + J_k (P - P_k)
///
/// The three differ in where J_k comes from. All are as good as J_k, and wrong by the object's
/// curvature over the distance travelled since the newest sample: errors grow with speed, delay and
/// hardening springs. Cost: a 3 x 3 product per query, at most a rank-one update per sample.
/// Memory: itself. A sample of the newest one's time replaces it.
class AffineMethod : public ContactModelMethod {
 public:
  /// Shorter steps between samples show only noise of the slope.
  static constexpr double kShortestStep_m = 0.5e-3;

  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept final;

 private:
  /// J_k from J_{k-1} and the step dP [m], dF [N] since the sample before (zero for the first).
  /// @returns false if the sample can't be used.
  virtual bool learn_slope(const Sample& sample, const Eigen::Vector3d& step_W_m,
                           const Eigen::Vector3d& change_W_N,
                           Eigen::Matrix3d& slope_W) const noexcept = 0;
  bool learn(const Sample& sample, bool first) noexcept final;
  void forget() noexcept final;

  Eigen::Vector3d position_W_ = Eigen::Vector3d::Zero();  ///< P_k [m]
  Eigen::Vector3d force_W_ = Eigen::Vector3d::Zero();     ///< F_k [N]
  Eigen::Matrix3d slope_W_ = Eigen::Matrix3d::Zero();     ///< J_k [N/m]
};

/// The slope along the last step only.
///
///   J_k = dF dPᵀ / |dP|²   if |dP| > 0.5 mm, else J_{k-1};   J_0 = 0
///
/// Source: Picinbono et al. (see LinearMethod), extrapolation in position. Needs: force. Knows no
/// slope across the last step, so on three-dimensional motion it is little better than hold.
class SecantMethod final : public AffineMethod {
 public:
  const char* name() const noexcept override { return "secant"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }

 private:
  bool learn_slope(const Sample& sample, const Eigen::Vector3d& step_W_m,
                   const Eigen::Vector3d& change_W_N,
                   Eigen::Matrix3d& slope_W) const noexcept override;
};

/// The smallest change of the slope that explains the last step, so that it keeps what it has
/// learnt in other directions.
///
///   J_k = J_{k-1} + (dF - J_{k-1} dP) dPᵀ / |dP|²   if |dP| > 0.5 mm, else J_{k-1};   J_0 = 0
///
/// Source: Broyden, "A class of methods for solving nonlinear simultaneous equations", Mathematics
/// of Computation 19 (1965). Needs: force. Fails with noise (a step of 0.5 mm turns 10 mN into
/// 20 N/m), with forces that depend on velocity, and with curvature.
class BroydenMethod final : public AffineMethod {
 public:
  const char* name() const noexcept override { return "broyden"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }

 private:
  bool learn_slope(const Sample& sample, const Eigen::Vector3d& step_W_m,
                   const Eigen::Vector3d& change_W_N,
                   Eigen::Matrix3d& slope_W) const noexcept override;
};

/// The slope that the simulator sends with the force: J_k = dF/dP at P_k.
///
/// Source: first-order Taylor expansion. Needs: force and stiffness; samples without it are
/// ignored. Knows the slope from the first sample on, but nothing of any sample before the newest,
/// so curvature costs it the same at every return to a place.
class TangentMethod final : public AffineMethod {
 public:
  const char* name() const noexcept override { return "tangent"; }
  MethodNeeds needs() const noexcept override { return {.stiffness = true, .requests = false}; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }

 private:
  bool learn_slope(const Sample& sample, const Eigen::Vector3d& step_W_m,
                   const Eigen::Vector3d& change_W_N,
                   Eigen::Matrix3d& slope_W) const noexcept override;
};

}  // namespace forcegrid
