// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/simple/contact_model_method.h"

#include <cmath>

namespace forcegrid {

void ContactModelMethod::take_sample(const Sample& sample) noexcept {
  if (!sample.force_W.allFinite() || !sample.position_W.allFinite() ||
      !std::isfinite(sample.time_s) || sample.from_query ||
      (has_sample_ && sample.time_s < newest_time_s_) || !learn(sample, !has_sample_)) {
    return;
  }
  newest_time_s_ = sample.time_s;
  has_sample_ = true;
  status_ = EstimateStatus::kOk;
}

void ContactModelMethod::contact_made(std::uint32_t /*epoch*/,
                                      const Eigen::Vector3d& /*point_W*/) noexcept {
  forget();
  has_sample_ = false;
  status_ = EstimateStatus::kUnknown;
}

void ContactModelMethod::contact_lost() noexcept {
  forget();
  has_sample_ = false;
  status_ = EstimateStatus::kOk;  // free space: the force is known to be zero
}

int ContactModelMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate ContactModelMethod::estimate(double time_s,
                                           const Eigen::Vector3d& model_force_W) const noexcept {
  ForceEstimate estimate;
  estimate.status = status_;
  estimate.force_W = model_force_W;
  if (!std::isfinite(time_s) || !estimate.force_W.allFinite()) {
    estimate.force_W.setZero();
    estimate.status = EstimateStatus::kNotFinite;
  }
  return estimate;
}

}  // namespace forcegrid
