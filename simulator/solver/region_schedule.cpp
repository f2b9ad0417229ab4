// SPDX-License-Identifier: Apache-2.0
#include "simulator/solver/region_schedule.h"

#include <algorithm>

namespace forcegrid::simulator {
namespace {

// A region gives up its last ring below this fraction of the border's allowed work.
constexpr double kShrinkBelow = 0.3;
// Every attempt with less than the whole object costs an answer of two parts.
constexpr int kMovesBetweenAttempts = 30;

}  // namespace

int RegionSchedule::next_levels(const Region& region, double border_share,
                                int most_vertices) noexcept {
  ++moves_;
  ++calm_moves_;
  int levels = region.solved();
  if (moves_ == 1) {
    levels = kFirstLevels;
  } else if (border_share > 1.0) {
    levels = region.larger();
  } else if (region.is_whole()) {
    levels -= moves_ - whole_since_ > kMovesBetweenAttempts ? 1 : 0;
  } else if (border_share < kShrinkBelow) {
    levels -= 1;
  }
  return region.limited(std::clamp(levels, 1, region.levels()), most_vertices);
}

}  // namespace forcegrid::simulator
