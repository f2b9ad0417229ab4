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

/// What a tool meets first of a surface.
struct SurfaceTouch {
  std::int32_t triangle = -1;  ///< index into the triangles that the tree was built of
  Touch touch;
};

/// A hierarchy of boxes over a surface of triangles whose vertices move: built once, refitted to
/// the vertices' new places at each step. Bounds stay right however far the surface has moved;
/// queries take longer where it has folded.
///
/// Source: van den Bergen, Efficient collision detection of complex deformable models using AABB
/// trees, J. Graphics Tools 2(4), 1997.
/// Real-time: after construction no allocation, lock or throw; refit() looks at every triangle
/// once, a query at what is near the tool. Threads: const calls from any, refit() from one alone.
class SurfaceTree {
 public:
  using Triangle = std::array<std::int32_t, 3>;

  /// @param triangles  vertex numbers, counterclockwise seen from outside.
  /// @param positions_W  [m] of all vertices, for the first fit and for how the tree is divided.
  /// @throws Error for a triangle that names a vertex that is not there, or a place that is not
  /// finite.
  SurfaceTree(std::vector<Triangle> triangles, std::span<const Eigen::Vector3d> positions_W);

  std::size_t triangle_count() const noexcept { return triangles_.size(); }
  std::size_t vertex_count() const noexcept { return positions_W_.size(); }
  const Triangle& triangle(std::size_t index) const noexcept { return triangles_[index]; }
  Corners corners_W(std::size_t index) const noexcept;

  /// The vertices have moved to `positions_W` [m].
  /// @returns false, and changes nothing, if their number is another or one is not finite.
  [[nodiscard]] bool refit(std::span<const Eigen::Vector3d> positions_W) noexcept;

  /// The nearest triangle to the tool, or the one that it has gone through farthest, if its gap is
  /// at most `margin_m`.
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
  // A bound from below of the gap between the tool and what is in `box`.
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
