// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/model_method.h"

#include <cmath>

namespace forcegrid::simulator {

void ModelMethod::take_sample(const Sample& /*sample*/) noexcept {}

void ModelMethod::contact_made(std::uint32_t /*epoch*/, const Eigen::Vector3d& point_W) noexcept {
  point_W_ = point_W;
  contact_ = point_W.allFinite() && hold(point_W) ? Contact::kHeld : Contact::kNotCovered;
}

void ModelMethod::contact_lost() noexcept { contact_ = Contact::kFree; }

int ModelMethod::work(int /*budget*/) noexcept { return 0; }

ForceEstimate ModelMethod::force(double time_s, const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
  } else if (contact_ == Contact::kFree) {
    estimate.status = EstimateStatus::kOk;
  } else if (contact_ == Contact::kHeld) {
    const Eigen::Vector3d force_W = response_N(position_W - point_W_);
    const bool finite = force_W.allFinite();
    estimate.status = finite ? EstimateStatus::kOk : EstimateStatus::kNotFinite;
    if (finite) {
      estimate.force_W = force_W;
    }
  }
  return estimate;
}

}  // namespace forcegrid::simulator
