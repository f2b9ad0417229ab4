// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/core/force_method.h"

namespace forcegrid {

/// What the methods share that fit one model to the samples of a contact and forget it when the
/// contact ends: which samples count, and what is known when.
///
/// Samples that are not finite, answers to queries, and samples older than the newest are ignored.
/// force() is kUnknown in contact until the first sample, kOk after it and out of contact, where
/// the force is known to be zero. Nothing is left for work(). Real-time: as ForceMethod.
class ContactModelMethod : public ForceMethod {
 public:
  void take_sample(const Sample& sample) noexcept final;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept final;
  void contact_lost() noexcept final;
  int work(int budget) noexcept final;

 protected:
  /// Takes a usable sample into the model. @param first of this contact.
  /// @returns false if the method has no use for it.
  virtual bool learn(const Sample& sample, bool first) noexcept = 0;
  /// Back to the model of before any sample, whose force is zero everywhere.
  virtual void forget() noexcept = 0;
  /// The estimate of a model's force. Not finite, the force is zero and the status kNotFinite; a
  /// position that is not finite has to make the force so.
  ForceEstimate estimate(double time_s, const Eigen::Vector3d& model_force_W) const noexcept;

 private:
  EstimateStatus status_ = EstimateStatus::kUnknown;
  bool has_sample_ = false;
  double newest_time_s_ = 0.0;
};

}  // namespace forcegrid
