// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/simple/hold_method.h"

#include <cmath>

namespace forcegrid {

void HoldMethod::take_sample(const Sample& sample) noexcept {
  if (!sample.force_W.allFinite() || !std::isfinite(sample.time_s) ||
      sample.time_s < newest_time_s_ || sample.from_query) {
    return;
  }
  newest_time_s_ = sample.time_s;
  estimate_.force_W = sample.force_W;
  estimate_.status = EstimateStatus::kOk;
}

void HoldMethod::contact_made(std::uint32_t /*epoch*/,
                              const Eigen::Vector3d& /*point_W*/) noexcept {
  estimate_ = ForceEstimate{};
}

void HoldMethod::contact_lost() noexcept {
  estimate_ = ForceEstimate{};
  estimate_.status = EstimateStatus::kOk;  // free space: the force is known to be zero
}

int HoldMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate HoldMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    ForceEstimate not_finite;
    not_finite.status = EstimateStatus::kNotFinite;
    return not_finite;
  }
  return estimate_;
}

}  // namespace forcegrid
