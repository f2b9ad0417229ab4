// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace forcegrid::evaluation {

/// Geometry of a picture in pixels; y points upwards.
struct PicturePoint {
  double x_px = 0.0;
  double y_px = 0.0;
};

struct PictureLine {
  PicturePoint from;
  PicturePoint to;
};

struct PictureBox {
  double left_px = 0.0;
  double right_px = 0.0;
  double bottom_px = 0.0;
  double top_px = 0.0;

  bool meets(const PictureBox& other) const noexcept;
  /// Whether a part of `line` lies within (Liang and Barsky's clipping).
  bool meets(const PictureLine& line) const noexcept;
};

/// A point of the picture and the size of its label.
struct LabelledPoint {
  PicturePoint at;
  double width_px = 0.0;
};

/// Where a label stands, and the line that leads to it.
struct PlacedLabel {
  PictureBox box;
  bool has_leader = false;  ///< the label is too far away to be told whose it is
  PictureLine leader;       ///< from the point to the nearest edge of the box
};

/// What labels have to keep clear of.
struct LabelSurroundings {
  PictureBox inside;               ///< of the plot
  std::vector<PictureBox> boxes;   ///< e.g. the legend, and points without a label
  std::vector<PictureLine> lines;  ///< curves
  double label_height_px = 14.0;
  double mark_radius_px = 5.0;
};

/// Places each label near its point: within the plot, and where there is room clear of points,
/// curves, other labels and their leaders. A label that finds no such place takes the one that
/// covers least.
std::vector<PlacedLabel> place_labels(const std::vector<LabelledPoint>& points,
                                      const LabelSurroundings& surroundings);

}  // namespace forcegrid::evaluation
