#pragma once

#include <string>
#include <vector>

#include "paper/observer.h"
#include "paper/options.h"

namespace forcegrid::paper {

/// How differently two of the three objects look while a tool holds both in the same place.
struct ShapeDifference {
  std::string first;
  std::string second;
  double rms_mm = 0.0;      ///< of the surface's vertices, over all places of the tool
  double largest_mm = 0.0;  ///< of one vertex
  /// The same over how far the surface has moved from rest (RMS): how much of what can be seen
  /// differs.
  double of_motion_percent = 0.0;
  /// Of an ideal observer who has the two side by side in mind, vertex by vertex, with an error of
  /// kSeen_mm in each coordinate: d' of one trial. Half a person's chance is at 0.
  double d_prime = 0.0;
};

/// One minute of arc at half a metre: what a healthy eye resolves on a screen.
inline constexpr double kSeen_mm = 0.145;

/// The three pairs of the discrimination test's objects, without force: the paper's users could not
/// tell them apart by looking.
/// @throws evaluation::Stopped, simulator::Error.
std::vector<ShapeDifference> compare_shapes(const PaperOptions& options);

}  // namespace forcegrid::paper
