// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>

#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// The newest sample and the stiffness there, and nothing of what was before:
///
///   F(P) = F_k + J_k (P - P_k)
///
/// J_k is the sample's own stiffness or, without one on the link, Broyden's update of J_{k-1} by
/// the step dP since the sample before, in which short steps count less, since they show noise:
///
///   J_k = J_{k-1} + (F_k - F(P_k)) dP^T / (|dP|^2 + (1 mm)^2)
///
/// For objects that change all the time, such as one that slides away under the tool: there every
/// older sample misleads.
///
/// A contact begins with the force zero at its point. The deviation that it states is that of its
/// last seven predictions, wherever they were. Failure: curvature, noise.
/// Cost: a 3 x 3 product. Real-time: nothing allocates, locks or throws. Threads: one.
/// Source: Broyden, Mathematics of Computation 19 (1965).
class NewestField final : public Field {
 public:
  explicit NewestField(const FieldSettings& settings) noexcept : settings_(settings) {}

  const FieldSettings& settings() const noexcept override { return settings_; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  int sample_count() const noexcept override { return has_sample_ ? 1 : 0; }
  int row_count() const noexcept override { return 0; }
  void enter_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept override;
  Innovation take(const Observation& observation) noexcept override;
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& /*position_m*/,
                                    const History& /*history*/) const noexcept override {
    return slope_N_per_m_;
  }
  double deviation_N(const Eigen::Vector3d& position_m,
                     const History& history) const noexcept override;

 private:
  FieldSettings settings_;
  bool has_sample_ = false;
  std::uint64_t contact_ = 0;
  Eigen::Vector3d position_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_N_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d slope_N_per_m_ = Eigen::Matrix3d::Zero();
  double error_N2_ = 0.0;  ///< of the last predictions, averaged
};

}  // namespace forcegrid::kriging
