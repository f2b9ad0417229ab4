// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "forcegrid/core/buffer.h"
#include "forcegrid/core/grid_geometry.h"

namespace forcegrid {

/// Chooses where to ask the simulator next, by the paper's rule: of the cells whose centre is
/// within rho of the tool, the one that has received the fewest samples; among equals, the one with
/// the nearest centre. A cell with an unanswered request counts one sample more.
/// Source: forcegrid paper, section 5, request method.
/// Real-time: only the constructor allocates. A plan visits the cells within rho, nearest first,
/// and stops at the first that is certain to be the answer. Threads: one.
class RequestPlanner {
 public:
  /// @param radius_m rho.
  RequestPlanner(const GridGeometry& geometry, double radius_m) noexcept;

  /// How many cells a plan visits in the worst case.
  static std::size_t cells_within(const GridGeometry& geometry, double radius_m) noexcept;

  bool allocated() const noexcept { return cells_.allocated(); }
  std::size_t bytes() const noexcept { return cells_.bytes(); }

  /// @param tool_W position, inside the grid.
  /// @param tool_cell the cell that holds it.
  /// @param samples_in callable, the number of samples in a cell.
  /// @param enough cells with this many samples are not requested.
  /// @param wanted_W set to the chosen cell's centre.
  /// @returns false, with `wanted_W` unchanged, if no cell has its centre within rho or all have
  ///   enough.
  template <typename SamplesIn>
  bool plan(const Eigen::Vector3d& tool_W, const Eigen::Vector3i& tool_cell, SamplesIn samples_in,
            int enough, Eigen::Vector3d& wanted_W) noexcept {
    const Eigen::Vector3d from_centre_m = tool_W - centre_W(tool_cell);
    int fewest = enough;
    double nearest_m = radius_m_;
    Eigen::Vector3i best(-1, -1, -1);
    for (std::size_t n = 0; n < cells_.size(); ++n) {
      const Cell& offset = cells_[n];
      if (offset.distance_m - half_diagonal_m_ > (fewest == 0 ? nearest_m : radius_m_)) {
        break;  // no cell from here on can be nearer
      }
      const Eigen::Vector3i cell = tool_cell + Eigen::Vector3i(offset.di, offset.dj, offset.dk);
      if ((cell.array() < 0).any() || (cell.array() >= geometry_.cells.array()).any()) {
        continue;
      }
      const double distance_m =
          (Eigen::Vector3d(offset.di, offset.dj, offset.dk).cwiseProduct(spacing_m_) -
           from_centre_m)
              .norm();
      if (distance_m > radius_m_) {
        continue;
      }
      const int samples = samples_in(cell) + waiting_for(cell);
      if (samples < fewest || (samples == fewest && best.x() >= 0 && distance_m < nearest_m)) {
        fewest = samples;
        nearest_m = distance_m;
        best = cell;
      }
    }
    if (best.x() < 0) {
      return false;
    }
    wanted_W = centre_W(best);
    waiting_[next_waiting_] = best;
    next_waiting_ = (next_waiting_ + 1) % waiting_.size();
    return true;
  }

  /// Counts the answer for this cell among its samples.
  void answered(const Eigen::Vector3i& cell) noexcept;
  /// Stops waiting for answers.
  void forget_requests() noexcept;

 private:
  struct Cell {
    std::int16_t di = 0, dj = 0, dk = 0;
    float distance_m = 0.0F;  ///< from centre to centre
  };

  Eigen::Vector3d centre_W(const Eigen::Vector3i& cell) const noexcept {
    return geometry_.min_W + (cell.cast<double>().array() + 0.5).matrix().cwiseProduct(spacing_m_);
  }
  int waiting_for(const Eigen::Vector3i& cell) const noexcept {
    int count = 0;
    for (const Eigen::Vector3i& waiting : waiting_) {
      count += waiting == cell ? 1 : 0;
    }
    return count;
  }

  GridGeometry geometry_;
  Eigen::Vector3d spacing_m_;
  double radius_m_;
  double half_diagonal_m_;
  Buffer<Cell> cells_;  ///< around the tool's own, in order of distance
  /// Answers that never come are forgotten after this many further requests.
  std::array<Eigen::Vector3i, 8> waiting_;
  std::size_t next_waiting_ = 0;
};

}  // namespace forcegrid
