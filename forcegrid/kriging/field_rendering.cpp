// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/field_rendering.h"

#include <cmath>

namespace forcegrid::kriging {

bool FieldRendering::answers_without_field(double time_s, const Eigen::Vector3d& position_W,
                                           const ContactState& contact,
                                           ForceEstimate& estimate) const noexcept {
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
    return true;
  }
  if (!contact.in_contact()) {
    if (contact.known()) {
      estimate.status = EstimateStatus::kOk;  // free space: the force is known to be zero
      estimate.uncertainty_N = 0.0;
    }
    return true;
  }
  return !contact.has_origin();
}

void FieldRendering::render(const Field& field, const History& history,
                            const Eigen::Vector3d& position_W, const ContactState& contact,
                            const Eigen::Vector3d& fading_N, double least_uncertainty_N,
                            ForceEstimate& estimate) const noexcept {
  const Eigen::Vector3d p = position_W - contact.origin_W();
  const Reading reading = field.read(p, history);
  if (!(reading.nearest_m2 < kUnknown_m * kUnknown_m) || !reading.force_N.allFinite()) {
    estimate.uncertainty_N = std::sqrt(field.settings().kernel.prior_variance_N2(p, history));
    return;
  }
  estimate.force_W = reading.force_N;
  if (fading_N.allFinite()) {  // unless it is from a field that had no answer
    estimate.force_W += fading_N;
  }
  add_uncertainty(position_W, least_uncertainty_N, estimate);
  if (reading.nearest_m2 > kFade_m * kFade_m) {
    const double left = (kUnknown_m - std::sqrt(reading.nearest_m2)) / (kUnknown_m - kFade_m);
    const double fade = left * left * (3.0 - 2.0 * left);
    estimate.force_W *= fade;
    estimate.uncertainty_N +=
        (1.0 - fade) * std::sqrt(field.settings().kernel.prior_variance_N2(p, history));
    estimate.status = EstimateStatus::kPartlyKnown;
  }
}

void FieldRendering::add_uncertainty(const Eigen::Vector3d& position_W, double least_uncertainty_N,
                                     ForceEstimate& estimate) const noexcept {
  estimate.uncertainty_N = uncertainty_.at_N(position_W, least_uncertainty_N);
  estimate.status = contact_sampled_ && estimate.uncertainty_N <= kKnown_N
                        ? EstimateStatus::kOk
                        : EstimateStatus::kPartlyKnown;
}

}  // namespace forcegrid::kriging
