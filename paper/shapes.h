// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "paper/observer.h"
#include "paper/options.h"

namespace forcegrid::paper {

/// Visible difference of two of the three objects while a tool holds both at the same position.
struct ShapeDifference {
  std::string first;
  std::string second;
  double rms_mm = 0.0;      ///< of the surface's vertices, over all positions of the tool
  double largest_mm = 0.0;  ///< of a single vertex
  /// The RMS difference over the surface's RMS displacement from rest.
  double of_motion_percent = 0.0;
  /// d' of one trial of an ideal observer that compares the two vertex by vertex, with an error of
  /// kSeen_mm in each coordinate. At 0 the observer can only guess.
  double d_prime = 0.0;
};

/// One minute of arc at half a metre: the resolution of a healthy eye on a screen.
inline constexpr double kSeen_mm = 0.145;

/// Compares the three pairs of the discrimination test's objects by sight alone; the paper's users
/// could not tell them apart by looking.
/// @throws evaluation::Stopped, simulator::Error.
std::vector<ShapeDifference> compare_shapes(const PaperOptions& options);

}  // namespace forcegrid::paper
