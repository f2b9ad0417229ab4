// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/label_placement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace forcegrid::evaluation {
namespace {

constexpr PictureBox kPlot{90.0, 975.0, 68.0, 572.0};

TEST(PictureBox, MeetsALineThatCrossesItAndNoOther) {
  const PictureBox box{10.0, 20.0, 10.0, 20.0};
  EXPECT_TRUE(box.meets(PictureLine{{0.0, 0.0}, {30.0, 30.0}}));
  EXPECT_TRUE(box.meets(PictureLine{{15.0, 0.0}, {15.0, 30.0}}));
  EXPECT_TRUE(box.meets(PictureLine{{12.0, 12.0}, {18.0, 13.0}})) << "within";
  EXPECT_FALSE(box.meets(PictureLine{{0.0, 21.0}, {30.0, 21.0}}));
  EXPECT_FALSE(box.meets(PictureLine{{0.0, 0.0}, {9.0, 30.0}}));
  EXPECT_FALSE(box.meets(PictureLine{{0.0, 0.0}, {8.0, 8.0}})) << "ends before it";
  EXPECT_FALSE(box.meets(PictureLine{{0.0, 25.0}, {25.0, 45.0}}));
}

// A front that falls from the upper left, as in a chart, with dominated points above it.
TEST(PlaceLabels, KeepsClearOfTheFrontThePointsAndEachOther) {
  constexpr unsigned kSeed = 7;
  SCOPED_TRACE(kSeed);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  std::vector<LabelledPoint> points;
  LabelSurroundings around;
  around.inside = kPlot;
  around.boxes.push_back(
      {kPlot.left_px, kPlot.left_px + 190.0, kPlot.bottom_px, kPlot.bottom_px + 66.0});
  for (int i = 0; i < 9; ++i) {
    const double x_px = 130.0 + 95.0 * i;
    points.push_back({{x_px, 520.0 - 55.0 * i + 8.0 * share(random)}, 60.0 + 90.0 * share(random)});
    if (i > 0) {
      around.lines.push_back({points[points.size() - 2].at, points.back().at});
    }
  }
  for (int i = 0; i < 12; ++i) {
    const double x_px = 200.0 + 700.0 * share(random);
    const double front_px = 520.0 - 55.0 / 95.0 * (x_px - 130.0);
    points.push_back({{x_px, front_px + 20.0 + (540.0 - front_px) * share(random)},
                      60.0 + 120.0 * share(random)});
  }
  const std::vector<PlacedLabel> labels = place_labels(points, around);
  ASSERT_EQ(labels.size(), points.size());
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const PictureBox& box = labels[i].box;
    EXPECT_DOUBLE_EQ(box.right_px - box.left_px, points[i].width_px);
    EXPECT_GE(box.left_px, kPlot.left_px) << i;
    EXPECT_LE(box.right_px, kPlot.right_px) << i;
    EXPECT_GE(box.bottom_px, kPlot.bottom_px) << i;
    EXPECT_LE(box.top_px, kPlot.top_px) << i;
    EXPECT_FALSE(box.meets(around.boxes.front())) << i << " lies on the legend";
    for (const PictureLine& line : around.lines) {
      EXPECT_FALSE(box.meets(line)) << i << " is struck through";
    }
    for (std::size_t j = 0; j < labels.size(); ++j) {
      EXPECT_TRUE(i == j || !box.meets(labels[j].box)) << i << " and " << j;
      const PicturePoint& at = points[j].at;
      EXPECT_FALSE(box.meets(PictureLine{at, at})) << i << " lies on point " << j;
    }
  }
}

TEST(PlaceLabels, PutsALonelyLabelBesideItsPointWithoutALeader) {
  LabelSurroundings around;
  around.inside = kPlot;
  const auto labels = place_labels({{{500.0, 300.0}, 80.0}, {{960.0, 300.0}, 80.0}}, around);
  EXPECT_FALSE(labels[0].has_leader);
  EXPECT_NEAR(labels[0].box.left_px, 508.0, 1e-9);
  EXPECT_NEAR(labels[1].box.right_px, 952.0, 1e-9) << "to the left, where there is room";
}

}  // namespace
}  // namespace forcegrid::evaluation
