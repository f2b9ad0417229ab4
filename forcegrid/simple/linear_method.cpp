// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/simple/linear_method.h"

#include <algorithm>
#include <cmath>

namespace forcegrid {

void LinearMethod::take_sample(const Sample& sample) noexcept {
  if (!sample.force_W.allFinite() || !std::isfinite(sample.time_s) || sample.from_query ||
      (has_sample_ && sample.time_s < newest_time_s_)) {
    return;
  }
  if (has_sample_ && sample.time_s > newest_time_s_) {
    rate_W_N_per_s_ = (sample.force_W - force_W_) / (sample.time_s - newest_time_s_);
  }
  newest_time_s_ = sample.time_s;
  force_W_ = sample.force_W;
  has_sample_ = true;
  status_ = EstimateStatus::kOk;
}

void LinearMethod::contact_made(std::uint32_t /*epoch*/,
                                const Eigen::Vector3d& /*point_W*/) noexcept {
  *this = LinearMethod();
}

void LinearMethod::contact_lost() noexcept {
  *this = LinearMethod();
  status_ = EstimateStatus::kOk;  // free space: the force is known to be zero
}

int LinearMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate LinearMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  estimate.status = status_;
  if (has_sample_) {
    const double ahead_s = std::min(time_s - newest_time_s_, kLongestExtrapolation_s);
    estimate.force_W = force_W_ + ahead_s * rate_W_N_per_s_;
  }
  if (!std::isfinite(time_s) || !position_W.allFinite() || !estimate.force_W.allFinite()) {
    estimate.force_W.setZero();
    estimate.status = EstimateStatus::kNotFinite;
  }
  return estimate;
}

}  // namespace forcegrid
