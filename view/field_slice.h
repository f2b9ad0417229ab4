// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "view/method_copies.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// Which part of the force field a page wants to see: a square around the tool.
struct SliceWish {
  std::size_t method = 0;               ///< in the loop's order
  std::optional<std::size_t> compared;  ///< the forces are the difference to this method's
  int normal = 1;                       ///< axis of W that the square is across: 0 x, 1 y, 2 z
  double size_m = 0.06;                 ///< of its side
  int points = 33;                      ///< along each side
};

inline constexpr int kFewestSlicePoints = 2;
inline constexpr int kMostSlicePoints = 65;
inline constexpr double kSmallestSlice_m = 0.001;
inline constexpr double kLargestSlice_m = 1.0;

/// Empty, or what is wrong with the wish for a run with so many methods.
const char* problem_of(const SliceWish& wish, std::size_t methods) noexcept;

/// Asks the copies for the field around `center_W` [m] and returns the binary message 6 of
/// docs/view_protocol.md. The wish has no problem_of(). Real-time: no; one query of a method for
/// each point, two where methods are compared.
view_link::Bytes slice_message(const MethodCopies& copies, const SliceWish& wish,
                               const Eigen::Vector3d& center_W);

}  // namespace forcegrid::view
