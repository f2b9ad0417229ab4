// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/core/force_method.h"

namespace forcegrid {

/// Streaming: the newest sample's force everywhere, until the next one (zero-order hold).
///
///   F(P, t) = F_k
///
/// Source: the streaming forces F_s of the forcegrid paper, section 6. Needs: force. Cost: a copy.
/// Fails with speed, delay and stiffness: a force that does not follow P between samples adds
/// negative damping K * age, so a hand of damping B feels it unstable beyond K = B / age.
class HoldMethod final : public ForceMethod {
 public:
  const char* name() const noexcept override { return "hold"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample& sample) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  int work(int budget) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

 private:
  ForceEstimate estimate_;
  double newest_time_s_ = -std::numeric_limits<double>::infinity();
};

}  // namespace forcegrid
