// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "simulator/kernels/spring_laws.h"

namespace forcegrid::simulator {

/// The part of an object around the tool that is solved, in rings: level 0 is the held patch, and
/// level n holds the vertices n springs or element edges away from it. Vertices that no springs
/// connect to the patch form the last level. Vertices are numbered by level, so that a region is
/// the head of every array, and its vertices' springs lead at most one level further. Source: the
/// solver study, section on local solving.
///
/// The levels below solved() are solved. The level after them, the border, is evaluated, and the
/// one after that is read. Farther out the object stays where it was when the region last reached
/// it.
class Region {
 public:
  /// All vertices in one level.
  explicit Region(std::int32_t vertices);

  /// Divides the vertices into levels around `patch` and makes the region the whole object.
  /// @returns the new order: element n is the present number of the vertex that becomes number n,
  ///          the patch first.
  std::vector<std::int32_t> number_around(const std::vector<std::int32_t>& patch,
                                          const kernels::SpringRows& rows);
  /// The same for pairs of vertices (first[n], second[n]) that act on each other.
  std::vector<std::int32_t> number_around(const std::vector<std::int32_t>& patch,
                                          std::span<const std::int32_t> first,
                                          std::span<const std::int32_t> second);

  int levels() const noexcept { return static_cast<int>(level_begin_.size()) - 1; }
  int solved() const noexcept { return solved_; }
  bool is_whole() const noexcept { return solved_ == levels(); }
  std::int32_t solved_vertices() const noexcept { return end_of(solved_); }
  /// How many levels the next larger region has: one more, or a fifth more.
  int larger() const noexcept;
  /// `levels`, or fewer if they have more than `vertices` vertices, at least 1; 0 vertices: no
  /// limit.
  int limited(int levels, int vertices) const noexcept;

  /// Makes the region the whole object; no vertex is left outside.
  void whole(kernels::Extent& extent) noexcept;

  /// Solves `levels` levels from now on, in 1..levels(), and sets the region's limits in `extent`.
  /// @param displacement  of the tool, stored for the vertices that are no longer reached.
  void set(int levels, const Eigen::Vector3d& displacement, kernels::Extent& extent) noexcept;

  /// How many vertices a region of at most `vertices` vertices visits, including its border and
  /// what the border reads.
  std::int32_t reach_of(int vertices) const noexcept {
    return end_of(limited(levels(), vertices) + 2);
  }
  /// Records that the vertices [first, end), whole levels, stand as with the tool at
  /// `displacement`.
  void leave_at(std::int32_t first, std::int32_t end, const Eigen::Vector3d& displacement) noexcept;

  /// The tool's displacement when the vertex, beyond the region's reach, was left.
  const Eigen::Vector3d& place(std::int32_t vertex) const noexcept {
    return place_[static_cast<std::size_t>(level_of_[static_cast<std::size_t>(vertex)])];
  }

 private:
  // Vertices in the first `levels` levels.
  std::int32_t end_of(int levels) const noexcept;

  std::vector<std::int32_t> level_begin_;  // and the end of the last
  std::vector<std::int32_t> level_of_;     // by vertex
  std::vector<Eigen::Vector3d> place_;     // by level
  int solved_ = 1;
};

/// Sorts `values` so that element n is the former element order[n].
template <typename Value>
void permute(const std::vector<std::int32_t>& order, std::vector<Value>& values) {
  std::vector<Value> sorted;
  sorted.reserve(values.size());
  for (const std::int32_t old : order) {
    sorted.push_back(values[static_cast<std::size_t>(old)]);
  }
  values.swap(sorted);
}

}  // namespace forcegrid::simulator
