// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/label_placement.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace forcegrid::evaluation {
namespace {

constexpr int kRings = 16;
constexpr double kGap_px = 8.0;      // between a point and a label beside it
constexpr double kStep_px = 4.0;     // further away with each ring
constexpr double kNearby_px = 20.0;  // a label beside its point needs no leader
constexpr double kOutside = 1000.0;  // costs of a place; the lowest sum wins
constexpr double kOnLabelOrPoint = 20.0;
constexpr double kOnCurve = 20.0;
constexpr double kOnLeader = 6.0;
constexpr double kFartherByARing = 0.5;

// Narrows [enter, leave] of the line's parameter to where p * t <= q.
bool clip(double p, double q, double& enter, double& leave) noexcept {
  if (p == 0.0) {
    return q >= 0.0;
  }
  const double t = q / p;
  (p < 0.0 ? enter : leave) = p < 0.0 ? std::max(enter, t) : std::min(leave, t);
  return enter <= leave;
}

class Placing {
 public:
  Placing(const std::vector<LabelledPoint>& points, const LabelSurroundings& around)
      : around_(around), boxes_(around.boxes) {
    const double r = around.mark_radius_px;
    for (const LabelledPoint& point : points) {
      boxes_.push_back(
          {point.at.x_px - r, point.at.x_px + r, point.at.y_px - r, point.at.y_px + r});
    }
  }

  PlacedLabel place(const LabelledPoint& point) {
    PlacedLabel best;
    double least = std::numeric_limits<double>::infinity();
    for (int ring = 0; ring < kRings; ++ring) {
      const double away_px = kGap_px + kStep_px * ring;
      for (int step = -ring; step <= ring; ++step) {
        const double y_px = point.at.y_px + around_.label_height_px * step;
        for (const double x_px : {point.at.x_px + away_px, point.at.x_px - away_px - point.width_px,
                                  point.at.x_px - 0.5 * point.width_px}) {
          const PlacedLabel candidate = label_at(point, x_px, y_px);
          const double cost = cost_of(candidate) + kFartherByARing * ring;
          if (cost < least) {
            least = cost;
            best = candidate;
          }
        }
      }
    }
    boxes_.push_back(best.box);
    if (best.has_leader) {
      leaders_.push_back(best.leader);
    }
    return best;
  }

 private:
  PlacedLabel label_at(const LabelledPoint& point, double x_px, double y_px) const {
    const double half_px = 0.5 * around_.label_height_px;
    PlacedLabel label;
    label.box = {x_px, x_px + point.width_px, y_px - half_px, y_px + half_px};
    const PicturePoint end{std::clamp(point.at.x_px, label.box.left_px, label.box.right_px),
                           std::clamp(point.at.y_px, label.box.bottom_px, label.box.top_px)};
    label.has_leader = std::abs(y_px - point.at.y_px) > around_.label_height_px ||
                       std::abs(end.x_px - point.at.x_px) > kNearby_px;
    label.leader = {point.at, end};
    return label;
  }

  double cost_of(const PlacedLabel& label) const {
    const PictureBox& box = label.box;
    const PictureBox& inside = around_.inside;
    double cost = box.left_px < inside.left_px || box.right_px > inside.right_px ||
                          box.bottom_px < inside.bottom_px || box.top_px > inside.top_px
                      ? kOutside
                      : 0.0;
    for (const PictureBox& taken : boxes_) {
      cost += box.meets(taken) ? kOnLabelOrPoint : 0.0;
      cost += label.has_leader && taken.meets(label.leader) ? kOnLeader : 0.0;
    }
    for (const PictureLine& line : around_.lines) {
      cost += box.meets(line) ? kOnCurve : 0.0;
    }
    for (const PictureLine& leader : leaders_) {
      cost += box.meets(leader) ? kOnLeader : 0.0;
    }
    return cost;
  }

  const LabelSurroundings& around_;
  std::vector<PictureBox> boxes_;  // legend, points, and the labels placed so far
  std::vector<PictureLine> leaders_;
};

}  // namespace

bool PictureBox::meets(const PictureBox& other) const noexcept {
  return left_px < other.right_px && other.left_px < right_px && bottom_px < other.top_px &&
         other.bottom_px < top_px;
}

bool PictureBox::meets(const PictureLine& line) const noexcept {
  const double dx_px = line.to.x_px - line.from.x_px;
  const double dy_px = line.to.y_px - line.from.y_px;
  double enter = 0.0;
  double leave = 1.0;
  return clip(-dx_px, line.from.x_px - left_px, enter, leave) &&
         clip(dx_px, right_px - line.from.x_px, enter, leave) &&
         clip(-dy_px, line.from.y_px - bottom_px, enter, leave) &&
         clip(dy_px, top_px - line.from.y_px, enter, leave);
}

std::vector<PlacedLabel> place_labels(const std::vector<LabelledPoint>& points,
                                      const LabelSurroundings& surroundings) {
  Placing placing(points, surroundings);
  std::vector<PlacedLabel> labels;
  labels.reserve(points.size());
  for (const LabelledPoint& point : points) {
    labels.push_back(placing.place(point));
  }
  return labels;
}

}  // namespace forcegrid::evaluation
