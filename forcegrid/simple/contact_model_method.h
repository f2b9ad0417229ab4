// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/core/force_method.h"

namespace forcegrid {

/// The common base of methods that fit one model to the samples of a contact and forget it when the
/// contact ends: which samples count, and when the force is known.
///
/// Samples that are not finite, answers to queries, and samples older than the newest are ignored.
/// In contact force() is kUnknown until the first sample and kOk after it; out of contact it is
/// kOk, since the force is known to be zero. work() has nothing to do. Real-time: as ForceMethod.
class ContactModelMethod : public ForceMethod {
 public:
  void take_sample(const Sample& sample) noexcept final;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept final;
  void contact_lost() noexcept final;
  int work(int budget) noexcept final;

 protected:
  /// Adds a usable sample to the model. @param first of this contact.
  /// @returns false if the method can't use it.
  virtual bool learn(const Sample& sample, bool first) noexcept = 0;
  /// Returns to the initial model, whose force is zero everywhere.
  virtual void forget() noexcept = 0;
  /// The estimate for a model's force. If that is not finite, the force is zero and the status
  /// kNotFinite; a position that is not finite must make the force not finite.
  ForceEstimate estimate(double time_s, const Eigen::Vector3d& model_force_W) const noexcept;

 private:
  EstimateStatus status_ = EstimateStatus::kUnknown;
  bool has_sample_ = false;
  double newest_time_s_ = 0.0;
};

}  // namespace forcegrid
