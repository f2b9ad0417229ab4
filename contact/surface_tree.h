// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "contact/distance.h"
#include "contact/tool_shape.h"

namespace forcegrid::contact {

/// The first contact of a tool with a surface.
struct SurfaceTouch {
  std::int32_t triangle = -1;  ///< index into the triangles that the tree was built of
  Touch touch;
};

/// A bounding-volume hierarchy (AABB tree) over a triangle surface whose vertices move. It is built
/// once and refitted to the vertices' new positions at each step. Results stay correct however far
/// the surface moves; queries take longer where it has folded.
///
/// Source: van den Bergen, Efficient collision detection of complex deformable models using AABB
/// trees, J. Graphics Tools 2(4), 1997. Real-time: after construction no allocation, lock or throw;
/// refit() visits every triangle once, a query those near the tool. Threads: const calls from any;
/// refit() from one, without other calls.
class SurfaceTree {
 public:
  using Triangle = std::array<std::int32_t, 3>;

  /// @param triangles  vertex numbers, counterclockwise seen from outside.
  /// @param positions_W  [m] of all vertices, for the first fit and for dividing the tree.
  /// @throws Error for a triangle with a missing vertex, or a position that is not finite.
  SurfaceTree(std::vector<Triangle> triangles, std::span<const Eigen::Vector3d> positions_W);

  std::size_t triangle_count() const noexcept { return triangles_.size(); }
  std::size_t vertex_count() const noexcept { return positions_W_.size(); }
  const Triangle& triangle(std::size_t index) const noexcept { return triangles_[index]; }
  Corners corners_W(std::size_t index) const noexcept;

  /// Moves the vertices to `positions_W` [m].
  /// @returns false, and changes nothing, if their number differs or one is not finite.
  [[nodiscard]] bool refit(std::span<const Eigen::Vector3d> positions_W) noexcept;

  /// The triangle nearest to the tool, or the one that it penetrates most; nothing if its gap is
  /// above `margin_m` [m].
  [[nodiscard]] std::optional<SurfaceTouch> nearest(const ToolShape& tool,
                                                    const Eigen::Vector3d& position_W,
                                                    double margin_m) const noexcept;

  /// Calls visit(triangle index) for every triangle whose box is within `margin_m` of the tool's
  /// boxes: all whose gap is at most that, and some more.
  template <typename Visit>
  void visit_near(const ToolShape& tool, const Eigen::Vector3d& position_W, double margin_m,
                  Visit visit) const noexcept;

 private:
  struct Box {
    Eigen::Array3d low_W = Eigen::Array3d::Zero();
    Eigen::Array3d high_W = Eigen::Array3d::Zero();
  };
  // Children follow their parent, the first one at once.
  struct Node {
    Box box;
    std::int32_t second_child = -1;  // -1: a leaf
    std::int32_t begin = 0;          // its triangles: order_[begin .. end - 1]
    std::int32_t end = 0;
  };
  static constexpr int kLeafTriangles = 4;
  static constexpr std::size_t kMaxDepth = 64;

  void build(std::int32_t begin, std::int32_t end, const std::vector<Eigen::Vector3d>& centres_W);
  void fit() noexcept;
  Box leaf_box(const Node& node) const noexcept;
  static std::array<Box, 2> boxes(const ToolShape& tool,
                                  const Eigen::Vector3d& position_W) noexcept;
  // A lower bound of the gap between the tool and the content of `box`.
  static double gap_bound_m(const ToolShape& tool, const std::array<Box, 2>& axes,
                            const Box& box) noexcept;

  std::vector<Triangle> triangles_;
  std::vector<std::int32_t> order_;
  std::vector<Node> nodes_;
  std::vector<Eigen::Vector3d> positions_W_;
};

template <typename Visit>
void SurfaceTree::visit_near(const ToolShape& tool, const Eigen::Vector3d& position_W,
                             double margin_m, Visit visit) const noexcept {
  if (nodes_.empty() || !position_W.allFinite()) {
    return;
  }
  const std::array<Box, 2> axes = boxes(tool, position_W);
  std::array<std::int32_t, kMaxDepth> open{};
  std::size_t count = 1;
  while (count > 0) {
    const std::int32_t at = open[--count];
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    if (gap_bound_m(tool, axes, node.box) > margin_m) {
      continue;
    }
    if (node.second_child >= 0) {
      open[count++] = node.second_child;
      open[count++] = at + 1;
      continue;
    }
    for (std::int32_t k = node.begin; k < node.end; ++k) {
      visit(order_[static_cast<std::size_t>(k)]);
    }
  }
}

}  // namespace forcegrid::contact
