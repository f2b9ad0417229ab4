// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/method_fade.h"

#include <algorithm>

#include "rt/vectors.h"

namespace forcegrid::servo {

Eigen::Vector3d MethodFade::force_W(double dt_s, std::size_t wanted,
                                    std::span<const Triple> forces_W_N) noexcept {
  wanted = wanted < forces_W_N.size() ? wanted : 0;
  const double missing = 1.0 - share_[wanted];
  const double left = std::max(0.0, missing - dt_s / kFade_s);
  if (missing > 0.0) {
    for (double& share : share_) {
      share *= left / missing;
    }
  }
  share_[wanted] = 1.0 - left;
  if (left == 0.0) {
    return rt::to_vector(forces_W_N[wanted]);  // to the last bit, also beside a force that is NaN
  }
  Eigen::Vector3d mean_W = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < forces_W_N.size(); ++i) {
    mean_W += share_[i] * rt::to_vector(forces_W_N[i]);
  }
  return mean_W;
}

}  // namespace forcegrid::servo
