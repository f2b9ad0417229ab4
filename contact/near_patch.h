// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>

#include "contact/distance.h"
#include "contact/tool_shape.h"

namespace forcegrid::contact {

/// A small copy of the part of a surface that a tool may touch next, for a real-time loop that
/// cannot access the whole surface. It has at most kMaxTriangles triangles in a tree of kLeaves
/// boxes, and is trivially copyable, so that it can be passed between threads.
///
/// The angle-weighted normal of the nearest face, edge or corner decides between inside and
/// outside. Source: Baerentzen and Aanaes, Signed distance computation using the angle weighted
/// pseudonormal, IEEE Trans. Visualization and Computer Graphics 11(3), 2005. Real-time: no
/// allocation, lock or throw; a query tests at most kMaxTriangles triangles. Threads: const calls
/// from any.
class NearPatch {
 public:
  static constexpr std::size_t kMaxVertices = 19;  ///< two rings around a vertex of a regular mesh
  static constexpr std::size_t kMaxTriangles = 27;
  static constexpr std::size_t kLeaves = 8;

  using Triangle = std::array<std::uint8_t, 3>;
  using Vertex = std::array<double, 3>;

  /// Position of a tool relative to the patch.
  struct Clearance {
    double gap_m = 0.0;  ///< of the tool's surface from the patch, negative inside
    Eigen::Vector3d normal_W = Eigen::Vector3d::UnitZ();  ///< unit, outward, the gap's gradient
    Eigen::Vector3d point_W = Eigen::Vector3d::Zero();    ///< [m] nearest point of the patch
    /// The nearest point lies on the patch's rim. The surface continues there, but the patch ends.
    bool at_rim = false;
  };

  /// @param vertices_W  [m]
  /// @param triangles  vertex numbers, counterclockwise seen from outside.
  /// @returns false, and holds nothing, for too many of either, a number without a vertex, or a
  /// vertex that is not finite.
  [[nodiscard]] bool set(std::span<const Vertex> vertices_W,
                         std::span<const Triangle> triangles) noexcept;

  std::size_t triangle_count() const noexcept { return triangle_count_; }

  /// Returns nothing if the patch has no triangle within `margin_m` [m] of the tool.
  /// @param tool  one capsule, in the tool's frame T; a point has neither length nor radius.
  /// @param position_W  [m] of T's origin.
  [[nodiscard]] std::optional<Clearance> clearance(const Capsule& tool,
                                                   const Eigen::Vector3d& position_W,
                                                   double margin_m) const noexcept;

 private:
  static constexpr std::size_t kNodes = 2 * kLeaves - 1;
  struct Box {
    Vertex low_W{};
    Vertex high_W{};
  };
  // Node i has the children 2 i + 1 and 2 i + 2.
  struct Node {
    Box box;
    std::uint8_t begin = 0;  // its triangles: order_[begin .. end - 1]
    std::uint8_t end = 0;
  };
  struct Search;

  Corners corners_W(std::size_t triangle) const noexcept;
  void divide(std::size_t node) noexcept;
  void fit(std::size_t node) noexcept;
  void find_rim() noexcept;
  void look_at(std::size_t triangle, Search& search) const noexcept;

  std::array<Vertex, kMaxVertices> vertices_W_{};
  std::array<Triangle, kMaxTriangles> triangles_{};
  std::array<std::uint8_t, kMaxTriangles> rim_edges_{};  // bit k: the edge opposite corner k
  std::array<std::uint8_t, kMaxTriangles> order_{};
  std::array<Node, kNodes> nodes_{};
  std::size_t triangle_count_ = 0;
};
static_assert(std::is_trivially_copyable_v<NearPatch>);

}  // namespace forcegrid::contact
