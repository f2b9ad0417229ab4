// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/request_planner.h"

#include <algorithm>
#include <tuple>

namespace forcegrid {
namespace {

// Cells whose centre may be within the radius of a tool anywhere in the middle cell.
template <typename Visit>
void visit_cells(const GridGeometry& geometry, double radius_m, Visit visit) noexcept {
  const Eigen::Vector3d spacing_m = geometry.spacing_m();
  const double reach_m = radius_m + 0.5 * spacing_m.norm();
  const Eigen::Vector3i reach =
      (reach_m / spacing_m.array()).floor().min(geometry.cells.cast<double>().array()).cast<int>();
  for (int i = -reach.x(); i <= reach.x(); ++i) {
    for (int j = -reach.y(); j <= reach.y(); ++j) {
      for (int k = -reach.z(); k <= reach.z(); ++k) {
        const double distance_m = Eigen::Vector3d(i, j, k).cwiseProduct(spacing_m).norm();
        if (distance_m <= reach_m) {
          visit(i, j, k, distance_m);
        }
      }
    }
  }
}

const Eigen::Vector3i kNoCell(-1, -1, -1);

}  // namespace

std::size_t RequestPlanner::cells_within(const GridGeometry& geometry, double radius_m) noexcept {
  std::size_t count = 0;
  visit_cells(geometry, radius_m, [&](int, int, int, double) { ++count; });
  return count;
}

RequestPlanner::RequestPlanner(const GridGeometry& geometry, double radius_m) noexcept
    : geometry_(geometry),
      spacing_m_(geometry.spacing_m()),
      radius_m_(radius_m),
      half_diagonal_m_(0.5 * spacing_m_.norm()),
      cells_(radius_m > 0.0 ? cells_within(geometry, radius_m) : 0, Cell{}) {
  forget_requests();
  if (cells_.size() == 0) {
    return;
  }
  std::size_t next = 0;
  visit_cells(geometry, radius_m, [&](int i, int j, int k, double distance_m) {
    cells_[next++] = {static_cast<std::int16_t>(i), static_cast<std::int16_t>(j),
                      static_cast<std::int16_t>(k), static_cast<float>(distance_m)};
  });
  std::sort(cells_.data(), cells_.data() + cells_.size(), [](const Cell& a, const Cell& b) {
    return std::tie(a.distance_m, a.di, a.dj, a.dk) < std::tie(b.distance_m, b.di, b.dj, b.dk);
  });
}

void RequestPlanner::answered(const Eigen::Vector3i& cell) noexcept {
  const auto found = std::find(waiting_.begin(), waiting_.end(), cell);
  if (found != waiting_.end()) {
    *found = kNoCell;
  }
}

void RequestPlanner::forget_requests() noexcept { waiting_.fill(kNoCell); }

}  // namespace forcegrid
