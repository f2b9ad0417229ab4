// SPDX-License-Identifier: Apache-2.0
#include "contact/near_patch.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

namespace forcegrid::contact {
namespace {

// Nearest points this close to each other count as one, on an edge or corner that triangles share.
constexpr double kSame_m = 1e-9;
constexpr double kOnEdge = 1e-9;  // a barycentric weight below this

Eigen::Map<const Eigen::Vector3d> vector(const NearPatch::Vertex& vertex) noexcept {
  return Eigen::Map<const Eigen::Vector3d>(vertex.data());
}

double angle_rad(const Corners& corners, std::size_t at) noexcept {
  const Eigen::Vector3d one = corners[(at + 1) % 3] - corners[at];
  const Eigen::Vector3d other = corners[(at + 2) % 3] - corners[at];
  return std::atan2(one.cross(other).norm(), one.dot(other));
}

// The part of a full turn around the point that the triangle covers.
double angle_at_rad(const Corners& corners, const Eigen::Vector3d& weights) noexcept {
  const auto off = (weights.array() < kOnEdge).count();
  if (off == 0) {
    return 2.0 * std::numbers::pi;
  }
  if (off == 1) {
    return std::numbers::pi;
  }
  Eigen::Index corner = 0;
  weights.maxCoeff(&corner);
  return angle_rad(corners, static_cast<std::size_t>(corner));
}

}  // namespace

struct NearPatch::Search {
  Eigen::Vector3d from_W;
  Eigen::Vector3d to_W;
  Eigen::Array3d low_W;
  Eigen::Array3d high_W;
  double best_m;
  Eigen::Vector3d on_axis_W = Eigen::Vector3d::Zero();
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
  Eigen::Vector3d outward_W = Eigen::Vector3d::Zero();
  bool found = false;
  bool at_rim = false;

  double bound_m(const Box& box) const noexcept {
    const Eigen::Array3d apart =
        (vector(box.low_W).array() - high_W).max(low_W - vector(box.high_W).array()).max(0.0);
    return apart.matrix().norm();
  }
};

bool NearPatch::set(std::span<const Vertex> vertices_W,
                    std::span<const Triangle> triangles) noexcept {
  triangle_count_ = 0;
  if (vertices_W.size() > kMaxVertices || triangles.size() > kMaxTriangles) {
    return false;
  }
  const auto finite = [](const Vertex& vertex) { return vector(vertex).allFinite(); };
  const auto known = [&vertices_W](const Triangle& triangle) {
    return std::ranges::all_of(triangle, [&](auto v) { return v < vertices_W.size(); });
  };
  if (!std::ranges::all_of(vertices_W, finite) || !std::ranges::all_of(triangles, known)) {
    return false;
  }
  std::ranges::copy(vertices_W, vertices_W_.begin());
  std::ranges::copy(triangles, triangles_.begin());
  triangle_count_ = triangles.size();
  std::iota(order_.begin(), order_.end(), std::uint8_t{0});
  nodes_[0].begin = 0;
  nodes_[0].end = static_cast<std::uint8_t>(triangle_count_);
  for (std::size_t node = 0; node < kNodes / 2; ++node) {
    divide(node);
  }
  for (std::size_t node = kNodes; node-- > 0;) {
    fit(node);
  }
  find_rim();
  return true;
}

Corners NearPatch::corners_W(std::size_t triangle) const noexcept {
  const Triangle& corners = triangles_[triangle];
  return {vector(vertices_W_[corners[0]]), vector(vertices_W_[corners[1]]),
          vector(vertices_W_[corners[2]])};
}

// In halves along the axis on which the triangles' centres are farthest apart.
void NearPatch::divide(std::size_t node) noexcept {
  const Node& whole = nodes_[node];
  const auto centre = [this](std::uint8_t triangle, Eigen::Index axis) {
    const Corners corners = corners_W(triangle);
    return corners[0][axis] + corners[1][axis] + corners[2][axis];
  };
  const auto begin = order_.begin() + whole.begin;
  const auto end = order_.begin() + whole.end;
  Eigen::Index widest = 0;
  double widest_m = -1.0;
  for (Eigen::Index axis = 0; axis < 3 && begin != end; ++axis) {
    const auto before = [&](auto a, auto b) { return centre(a, axis) < centre(b, axis); };
    const auto [low, high] = std::minmax_element(begin, end, before);
    const double width_m = centre(*high, axis) - centre(*low, axis);
    if (width_m > widest_m) {
      widest_m = width_m;
      widest = axis;
    }
  }
  const auto middle = static_cast<std::uint8_t>((whole.begin + whole.end) / 2);
  std::nth_element(begin, order_.begin() + middle, end,
                   [&](auto a, auto b) { return centre(a, widest) < centre(b, widest); });
  nodes_[2 * node + 1].begin = whole.begin;
  nodes_[2 * node + 1].end = middle;
  nodes_[2 * node + 2].begin = middle;
  nodes_[2 * node + 2].end = whole.end;
}

void NearPatch::fit(std::size_t node) noexcept {
  Box& box = nodes_[node].box;
  box.low_W.fill(std::numeric_limits<double>::infinity());
  box.high_W.fill(-std::numeric_limits<double>::infinity());
  for (std::size_t k = nodes_[node].begin; k < nodes_[node].end; ++k) {
    for (const std::uint8_t v : triangles_[order_[k]]) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.low_W[axis] = std::min(box.low_W[axis], vertices_W_[v][axis]);
        box.high_W[axis] = std::max(box.high_W[axis], vertices_W_[v][axis]);
      }
    }
  }
}

void NearPatch::find_rim() noexcept {
  const auto has = [this](std::size_t t, std::uint8_t v) {
    return std::ranges::find(triangles_[t], v) != triangles_[t].end();
  };
  for (std::size_t t = 0; t < triangle_count_; ++t) {
    rim_edges_[t] = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint8_t a = triangles_[t][(k + 1) % 3];
      const std::uint8_t b = triangles_[t][(k + 2) % 3];
      bool shared = false;
      for (std::size_t other = 0; other < triangle_count_; ++other) {
        shared = shared || (other != t && has(other, a) && has(other, b));
      }
      rim_edges_[t] = static_cast<std::uint8_t>(rim_edges_[t] | (shared ? 0U : 1U << k));
    }
  }
}

void NearPatch::look_at(std::size_t triangle, Search& search) const noexcept {
  const Corners corners = corners_W(triangle);
  const AxisToTriangle pair = nearest(search.from_W, search.to_W, corners);
  if (!(pair.distance_m <= search.best_m + (search.found ? kSame_m : 0.0))) {
    return;
  }
  const bool nearer = !search.found || pair.distance_m < search.best_m - kSame_m;
  if (!nearer && (pair.on_triangle - search.point_W).norm() > kSame_m) {
    return;  // equally near elsewhere: one place is enough
  }
  if (nearer) {
    search.best_m = pair.distance_m;
    search.on_axis_W = pair.on_axis;
    search.point_W = pair.on_triangle;
    search.outward_W.setZero();
    search.at_rim = false;
    search.found = true;
  }
  const Eigen::Vector3d face = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
  if (face.squaredNorm() > 0.0) {
    search.outward_W += angle_at_rad(corners, pair.weights) * face.normalized();
  }
  for (std::size_t k = 0; k < 3; ++k) {
    const bool on_edge = pair.weights[static_cast<Eigen::Index>(k)] < kOnEdge;
    search.at_rim = search.at_rim || (on_edge && (rim_edges_[triangle] >> k & 1U) != 0);
  }
}

std::optional<NearPatch::Clearance> NearPatch::clearance(const Capsule& tool,
                                                         const Eigen::Vector3d& position_W,
                                                         double margin_m) const noexcept {
  if (triangle_count_ == 0 || !position_W.allFinite()) {
    return std::nullopt;
  }
  Search search;
  search.from_W = position_W + tool.from_T;
  search.to_W = position_W + tool.to_T;
  search.low_W = search.from_W.array().min(search.to_W.array());
  search.high_W = search.from_W.array().max(search.to_W.array());
  search.best_m = margin_m + tool.radius_m;
  std::array<std::pair<double, std::size_t>, kNodes> open{};
  open[0] = {search.bound_m(nodes_[0].box), 0};
  std::size_t count = 1;
  while (count > 0) {
    const auto [bound_m, node] = open[--count];
    if (bound_m > search.best_m + kSame_m) {
      continue;
    }
    if (node < kNodes / 2) {
      std::pair near(search.bound_m(nodes_[2 * node + 1].box), 2 * node + 1);
      std::pair far(search.bound_m(nodes_[2 * node + 2].box), 2 * node + 2);
      if (far.first < near.first) {
        std::swap(near, far);
      }
      open[count++] = far;
      open[count++] = near;
      continue;
    }
    for (std::size_t k = nodes_[node].begin; k < nodes_[node].end; ++k) {
      look_at(order_[k], search);
    }
  }
  if (!search.found || !(search.outward_W.norm() > 0.0)) {
    return std::nullopt;
  }
  const Eigen::Vector3d away_W = search.on_axis_W - search.point_W;
  const double side = away_W.dot(search.outward_W) < 0.0 ? -1.0 : 1.0;
  Clearance result;
  result.gap_m = side * search.best_m - tool.radius_m;
  result.normal_W = search.best_m > kSame_m ? Eigen::Vector3d(side / search.best_m * away_W)
                                            : search.outward_W.normalized();
  result.point_W = search.point_W;
  result.at_rim = search.at_rim;
  return result;
}

}  // namespace forcegrid::contact
