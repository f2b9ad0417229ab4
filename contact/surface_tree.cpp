// SPDX-License-Identifier: Apache-2.0
#include "contact/surface_tree.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "contact/error.h"

namespace forcegrid::contact {
namespace {

bool all_finite(std::span<const Eigen::Vector3d> positions_W) noexcept {
  return std::all_of(positions_W.begin(), positions_W.end(),
                     [](const Eigen::Vector3d& position_W) { return position_W.allFinite(); });
}

}  // namespace

SurfaceTree::SurfaceTree(std::vector<Triangle> triangles,
                         std::span<const Eigen::Vector3d> positions_W)
    : triangles_(std::move(triangles)), positions_W_(positions_W.begin(), positions_W.end()) {
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    for (const std::int32_t vertex : triangles_[t]) {
      if (vertex < 0 || static_cast<std::size_t>(vertex) >= positions_W_.size()) {
        throw Error("surface: triangle " + std::to_string(t) + " names vertex " +
                    std::to_string(vertex) + "; there are " + std::to_string(positions_W_.size()) +
                    ", counted from 0");
      }
    }
  }
  if (!all_finite(positions_W)) {
    throw Error("surface: the place of a vertex is not finite; give finite coordinates in metres");
  }
  if (triangles_.empty()) {
    return;
  }
  order_.resize(triangles_.size());
  std::iota(order_.begin(), order_.end(), 0);
  std::vector<Eigen::Vector3d> centres_W;
  centres_W.reserve(triangles_.size());
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    const Corners corners = corners_W(t);
    centres_W.push_back((corners[0] + corners[1] + corners[2]) / 3.0);
  }
  nodes_.reserve(2 * triangles_.size());
  build(0, static_cast<std::int32_t>(triangles_.size()), centres_W);
  fit();
}

Corners SurfaceTree::corners_W(std::size_t index) const noexcept {
  const Triangle& triangle = triangles_[index];
  return {positions_W_[static_cast<std::size_t>(triangle[0])],
          positions_W_[static_cast<std::size_t>(triangle[1])],
          positions_W_[static_cast<std::size_t>(triangle[2])]};
}

// Splits in two equal numbers along the longest side, so that the depth is logarithmic.
void SurfaceTree::build(std::int32_t begin, std::int32_t end,
                        const std::vector<Eigen::Vector3d>& centres_W) {
  const std::size_t at = nodes_.size();
  nodes_.push_back(Node{.box = {}, .second_child = -1, .begin = begin, .end = end});
  if (end - begin <= kLeafTriangles) {
    return;
  }
  const auto centre_W = [&](std::int32_t triangle) -> const Eigen::Vector3d& {
    return centres_W[static_cast<std::size_t>(triangle)];
  };
  Eigen::Array3d low_W = centre_W(order_[static_cast<std::size_t>(begin)]).array();
  Eigen::Array3d high_W = low_W;
  for (std::int32_t k = begin; k < end; ++k) {
    low_W = low_W.min(centre_W(order_[static_cast<std::size_t>(k)]).array());
    high_W = high_W.max(centre_W(order_[static_cast<std::size_t>(k)]).array());
  }
  Eigen::Index axis = 0;
  (high_W - low_W).maxCoeff(&axis);
  const std::int32_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](std::int32_t a, std::int32_t b) {
                     return std::pair(centre_W(a)[axis], a) < std::pair(centre_W(b)[axis], b);
                   });
  build(begin, middle, centres_W);
  nodes_[at].second_child = static_cast<std::int32_t>(nodes_.size());
  build(middle, end, centres_W);
}

SurfaceTree::Box SurfaceTree::leaf_box(const Node& node) const noexcept {
  const auto index = [this](std::int32_t k) {
    return static_cast<std::size_t>(order_[static_cast<std::size_t>(k)]);
  };
  const Eigen::Array3d first_W = corners_W(index(node.begin))[0].array();
  Box box{first_W, first_W};
  for (std::int32_t k = node.begin; k < node.end; ++k) {
    for (const Eigen::Vector3d& corner_W : corners_W(index(k))) {
      box.low_W = box.low_W.min(corner_W.array());
      box.high_W = box.high_W.max(corner_W.array());
    }
  }
  return box;
}

// Backwards, since children come after their parents.
void SurfaceTree::fit() noexcept {
  for (std::size_t at = nodes_.size(); at-- > 0;) {
    Node& node = nodes_[at];
    if (node.second_child < 0) {
      node.box = leaf_box(node);
    } else {
      const Box& first = nodes_[at + 1].box;
      const Box& second = nodes_[static_cast<std::size_t>(node.second_child)].box;
      node.box = {first.low_W.min(second.low_W), first.high_W.max(second.high_W)};
    }
  }
}

bool SurfaceTree::refit(std::span<const Eigen::Vector3d> positions_W) noexcept {
  if (positions_W.size() != positions_W_.size() || !all_finite(positions_W)) {
    return false;
  }
  std::copy(positions_W.begin(), positions_W.end(), positions_W_.begin());
  fit();
  return true;
}

std::array<SurfaceTree::Box, 2> SurfaceTree::boxes(const ToolShape& tool,
                                                   const Eigen::Vector3d& position_W) noexcept {
  std::array<Box, 2> axes;
  std::size_t part = 0;
  for (const Capsule& capsule : tool.parts()) {
    const Eigen::Array3d from_W = (position_W + capsule.from_T).array();
    const Eigen::Array3d to_W = (position_W + capsule.to_T).array();
    axes[part++] = {from_W.min(to_W), from_W.max(to_W)};
  }
  return axes;
}

double SurfaceTree::gap_bound_m(const ToolShape& tool, const std::array<Box, 2>& axes,
                                const Box& box) noexcept {
  double bound_m = std::numeric_limits<double>::infinity();
  std::size_t part = 0;
  for (const Capsule& capsule : tool.parts()) {
    const Box& axis = axes[part++];
    const Eigen::Array3d apart = (box.low_W - axis.high_W).max(axis.low_W - box.high_W).max(0.0);
    bound_m = std::min(bound_m, apart.matrix().norm() - capsule.radius_m);
  }
  return bound_m;
}

std::optional<SurfaceTouch> SurfaceTree::nearest(const ToolShape& tool,
                                                 const Eigen::Vector3d& position_W,
                                                 double margin_m) const noexcept {
  if (nodes_.empty() || !position_W.allFinite()) {
    return std::nullopt;
  }
  const std::array<Box, 2> axes = boxes(tool, position_W);
  SurfaceTouch best;
  double best_m = margin_m;
  std::array<std::pair<double, std::int32_t>, kMaxDepth> open{};
  open[0] = {gap_bound_m(tool, axes, nodes_[0].box), 0};
  std::size_t count = 1;
  while (count > 0) {
    const auto [bound_m, at] = open[--count];
    if (bound_m > best_m) {
      continue;
    }
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    if (node.second_child >= 0) {
      std::pair near(gap_bound_m(tool, axes, nodes_[static_cast<std::size_t>(at) + 1].box), at + 1);
      std::pair far(
          gap_bound_m(tool, axes, nodes_[static_cast<std::size_t>(node.second_child)].box),
          node.second_child);
      if (far.first < near.first) {
        std::swap(near, far);
      }
      open[count++] = far;
      open[count++] = near;
      continue;
    }
    for (std::int32_t k = node.begin; k < node.end; ++k) {
      const std::int32_t index = order_[static_cast<std::size_t>(k)];
      const Touch touch =
          contact::nearest(tool, position_W, corners_W(static_cast<std::size_t>(index)));
      if (touch.gap_m < best_m || (touch.gap_m == best_m && best.triangle < 0)) {
        best_m = touch.gap_m;
        best = {index, touch};
      }
    }
  }
  return best.triangle < 0 ? std::nullopt : std::optional(best);
}

}  // namespace forcegrid::contact
