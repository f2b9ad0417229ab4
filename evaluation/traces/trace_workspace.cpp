// SPDX-License-Identifier: Apache-2.0
#include "evaluation/traces/trace_workspace.h"

#include <algorithm>

namespace forcegrid::evaluation {
namespace {

constexpr double kMargin_m = 0.03;

bool holds(const GridGeometry& grid, const Eigen::Vector3d& position_W) {
  return (position_W.array() >= grid.min_W.array()).all() &&
         (position_W.array() <= grid.max_W.array()).all();
}

// A trace with the positions of both tools.
Trace positions_of(const PairTrace& pair) {
  Trace both;
  for (const PairInstant& instant : pair.servo) {
    both.servo.push_back({instant.time_s, instant.positions_W.head<3>(), {}});
    both.servo.push_back({instant.time_s, instant.positions_W.tail<3>(), {}});
  }
  return both;
}

}  // namespace

GridGeometry default_trace_workspace() {
  GridGeometry grid;
  grid.max_W = {0.16, 0.12, 0.12};
  grid.cells.setConstant(49);
  return grid;
}

std::size_t positions_outside(const GridGeometry& grid, const Trace& trace) {
  const auto outside = [&](const Eigen::Vector3d& position_W) { return !holds(grid, position_W); };
  return static_cast<std::size_t>(
      std::count_if(trace.servo.begin(), trace.servo.end(),
                    [&](const auto& instant) { return outside(instant.position_W); }) +
      std::count_if(trace.samples.begin(), trace.samples.end(),
                    [&](const auto& row) { return outside(row.sample.position_W); }));
}

GridGeometry box_around(const Trace& trace) {
  GridGeometry grid = default_trace_workspace();
  grid.min_W = grid.max_W = trace.servo.front().position_W;
  const auto include = [&](const Eigen::Vector3d& position_W) {
    grid.min_W = grid.min_W.cwiseMin(position_W);
    grid.max_W = grid.max_W.cwiseMax(position_W);
  };
  for (const auto& instant : trace.servo) {
    include(instant.position_W);
  }
  for (const auto& row : trace.samples) {
    include(row.sample.position_W);
  }
  grid.min_W.array() -= kMargin_m;
  grid.max_W.array() += kMargin_m;
  return grid;
}

std::size_t positions_outside(const GridGeometry& grid, const PairTrace& trace) {
  return positions_outside(grid, positions_of(trace));
}

GridGeometry workspace_of(const PairTrace& trace, const GridGeometry& grid) {
  return positions_outside(grid, trace) == 0 ? grid : box_around(positions_of(trace));
}

}  // namespace forcegrid::evaluation
