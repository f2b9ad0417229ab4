#pragma once

#include <Eigen/Core>
#include <vector>

#include "stability/closed_loop.h"

namespace forcegrid::stability {

/// How a tool that should be still behaves.
struct Settling {
  Behaviour behaviour = Behaviour::kStable;  ///< never kDivergence
  double peak_to_peak_m = 0.0;               ///< of the axis that moves most
};

/// Judges positions [m] at equal intervals: less than StatedRun::kSettled_m peak to peak is stable.
/// Otherwise what is left after a straight line has been taken out of the axis that moves most
/// tells oscillation from creep: more than half of the peak to peak is a limit cycle.
Settling judge_settling(const std::vector<Eigen::Vector3d>& positions_W);

}  // namespace forcegrid::stability
