// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/simple/contact_model_method.h"

namespace forcegrid {

/// Recursive least squares: one quadratic field fitted to all samples with exponential forgetting,
/// anchored at the newest.
///
///   u = (P - c) / 20 mm,   phi = (1, u_x, u_y, u_z, u_x², u_y², u_z², u_x u_y, u_x u_z, u_y u_z)
///   A_k = 0.97 A_{k-1} + phi_k phi_kᵀ,   B_k = 0.97 B_{k-1} + phi_k F_kᵀ
///   theta = (A + diag(1e-9; 1e-4 x 3; 1e-3 x 6))⁻¹ B
///   F(P) = thetaᵀ phi(P) + (F_k - thetaᵀ phi(P_k))
///
/// c is the first sample's position in a contact. The last term is the anchor: the residual at the
/// newest sample, added everywhere.
/// Source: a buffer model in the sense of Balaniuk, "Using fast local modelling to buffer haptic
/// data" (PHANToM Users Group workshop, 1999), with regularised normal equations instead of his
/// geometry.
/// Needs: force. Cost: 30 multiplications per query; a Cholesky factorisation of 10 x 10 per
/// sample. Memory: itself. Fails where a quadratic does not fit: after a cut until old samples have
/// faded, at kinks, and on a light grip with a fast simulator, where the samples of a moment span
/// too little.
class RlsMethod final : public ContactModelMethod {
 public:
  static constexpr int kFeatures = 10;
  using Features = Eigen::Matrix<double, kFeatures, 1>;

  const char* name() const noexcept override { return "rls"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

 private:
  Features features_at(const Eigen::Vector3d& position_W) const noexcept;
  bool learn(const Sample& sample, bool first) noexcept override;
  void forget() noexcept override;

  Eigen::Vector3d centre_W_ = Eigen::Vector3d::Zero();  ///< c [m]
  Eigen::Matrix<double, kFeatures, kFeatures> gram_ =
      Eigen::Matrix<double, kFeatures, kFeatures>::Zero();  ///< A
  Eigen::Matrix<double, kFeatures, 3> moment_W_N_ =
      Eigen::Matrix<double, kFeatures, 3>::Zero();  ///< B [N]
  /// thetaᵀ [N] with the anchor added to the constant's column; one column per feature.
  Eigen::Matrix<double, 3, kFeatures> anchored_W_N_ = Eigen::Matrix<double, 3, kFeatures>::Zero();
};

}  // namespace forcegrid
