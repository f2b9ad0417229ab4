// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "stability/closed_loop.h"

namespace forcegrid::stability {

/// Behaviour of a tool that should be still.
struct Settling {
  Behaviour behaviour = Behaviour::kStable;  ///< never kDivergence
  double peak_to_peak_m = 0.0;               ///< of the axis that moves most
};

/// Classifies positions [m] at equal intervals. Less than StatedRun::kSettled_m peak to peak is
/// stable. Otherwise, a straight line is subtracted from the axis that moves most. If more than
/// half of its peak-to-peak motion remains, it is a limit cycle, else creep.
Settling judge_settling(const std::vector<Eigen::Vector3d>& positions_W);

}  // namespace forcegrid::stability
