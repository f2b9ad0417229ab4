// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "forcegrid/core/force_method.h"
#include "forcegrid/kriging/contact_state.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/uncertainty_line.h"

namespace forcegrid::kriging {

/// Turns a field's answer into a ForceEstimate: status, uncertainty, and the fade where no sample
/// is near.
///
/// Out of contact: zero, kOk; kUnknown before the first contact was made or lost. In contact:
/// kUnknown beyond kUnknown_m from every sample and while the field has none. Between kFade_m and
/// kUnknown_m the force fades to zero (smoothstep) and the status is kPartlyKnown. Elsewhere kOk
/// if the field has a sample of this contact and the uncertainty is at most kKnown_N, else
/// kPartlyKnown.
/// Real-time: nothing allocates, locks or throws. Cost of render(): one Field::read().
class FieldRendering {
 public:
  static constexpr double kFade_m = 0.060;     ///< twice the kernels' length
  static constexpr double kUnknown_m = 0.090;  ///< three times the kernels' length
  static constexpr double kKnown_N = 0.3;

  /// A contact begins; the rendered field has no sample of it yet.
  void begin_contact() noexcept { contact_sampled_ = false; }
  /// The rendered field took a sample of this contact.
  void contact_sampled() noexcept { contact_sampled_ = true; }
  bool is_contact_sampled() const noexcept { return contact_sampled_; }

  /// The uncertainty along the motion; update it whenever the rendered field has changed.
  UncertaintyLine& uncertainty() noexcept { return uncertainty_; }

  /// Answers where the field is not needed. @returns true if `estimate` is complete.
  bool answers_without_field(double time_s, const Eigen::Vector3d& position_W,
                             const ContactState& contact, ForceEstimate& estimate) const noexcept;
  /// @param history of the path at `position_W`, for fields that use it; else zero.
  /// @param fading_N the rest of an earlier field's force, see HandOverFade.
  void render(const Field& field, const History& history, const Eigen::Vector3d& position_W,
              const ContactState& contact, const Eigen::Vector3d& fading_N,
              double least_uncertainty_N, ForceEstimate& estimate) const noexcept;
  /// Adds uncertainty and status to a force of the field within kFade_m of a sample.
  void add_uncertainty(const Eigen::Vector3d& position_W, double least_uncertainty_N,
                       ForceEstimate& estimate) const noexcept;

 private:
  UncertaintyLine uncertainty_;
  bool contact_sampled_ = false;
};

}  // namespace forcegrid::kriging
