// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/solver/region.h"

namespace forcegrid::simulator {

/// Decides how many rings a local solver solves at each move, see SolverOptions::border_tolerance
/// and most_vertices. It takes the border's share: the work residual on the border over the allowed
/// one.
class RegionSchedule {
 public:
  void reset() noexcept { *this = RegionSchedule(); }

  /// Begins a move: how many rings it solves.
  int next_levels(const Region& region, double border_share, int most_vertices) noexcept;

  /// Whether the region changed in the last few moves. What is corrected at once there is no trend.
  bool region_is_new() const noexcept { return calm_moves_ < kCalmMoves; }
  void region_changed() noexcept { calm_moves_ = 0; }
  /// A move that grew its region to the whole object has ended.
  void became_whole() noexcept { whole_since_ = moves_; }

 private:
  static constexpr int kCalmMoves = 4;
  static constexpr int kFirstLevels = 4;

  int moves_ = 0;
  int whole_since_ = 0;
  int calm_moves_ = 0;  // since the region changed
};

}  // namespace forcegrid::simulator
