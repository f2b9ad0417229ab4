// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/core/force_method.h"

namespace forcegrid {

/// Extrapolates the force in time along the line through the two newest samples.
///
///   F(P, t) = F_k + (F_k - F_{k-1}) / (t_k - t_{k-1}) * min(t - t_k, 0.25 s)
///
/// t_k is the time that F_k was computed for; P is not used. A sample of the same time as the one
/// before replaces it without changing the slope.
/// Source: extrapolation in time after Picinbono, Lombardo, Delingette, Ayache, "Improving
/// realism of a surgery simulator: linear anisotropic elasticity, complex interactions and force
/// extrapolation", J. Visualization and Computer Animation 13 (2002).
/// Needs: force. Cost: three multiplications per query, a division per sample. Memory: itself.
/// Fails where the motion reverses, with noise, and with delay, since the slope amplifies all
/// three; like any force that does not follow P it is unstable on a light grip.
class LinearMethod final : public ForceMethod {
 public:
  static constexpr double kLongestExtrapolation_s = 0.25;

  const char* name() const noexcept override { return "linear"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample& sample) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  int work(int budget) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

 private:
  EstimateStatus status_ = EstimateStatus::kUnknown;
  bool has_sample_ = false;
  double newest_time_s_ = 0.0;                         ///< t_k
  Eigen::Vector3d force_W_ = Eigen::Vector3d::Zero();  ///< F_k [N]
  Eigen::Vector3d rate_W_N_per_s_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid
