// SPDX-License-Identifier: Apache-2.0
// What an estimate is made of: the field, its uncertainty along the motion, and fades.

#include "forcegrid/kriging/field_rendering.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "forcegrid/kriging/default_fields.h"
#include "forcegrid/kriging/hand_over_fade.h"
#include "forcegrid/kriging/uncertainty_line.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

TEST(HandOverFade, StartsWithTheWholeDifferenceAndFadesOut) {
  HandOverFade fade(0.010);
  EXPECT_EQ(fade.at(1.0), Vector3d::Zero());
  fade.start(1.0, Vector3d(3.0, 0.0, 0.0), Vector3d(1.0, 0.0, 0.0));
  EXPECT_EQ(fade.at(1.0).x(), 2.0);
  EXPECT_NEAR(fade.at(1.01).x(), 2.0 * std::exp(-1.0), 1e-12);
  EXPECT_EQ(fade.at(1.06), Vector3d::Zero());
}

TEST(HandOverFade, CarriesOnWhatIsLeft) {
  HandOverFade fade(0.010);
  fade.start(1.0, Vector3d(2.0, 0.0, 0.0), Vector3d::Zero());
  fade.start(1.01, Vector3d::Zero(), Vector3d(1.0, 0.0, 0.0));
  EXPECT_NEAR(fade.at(1.01).x(), 2.0 * std::exp(-1.0) - 1.0, 1e-12);
  fade.clear();
  EXPECT_EQ(fade.at(1.01), Vector3d::Zero());
}

// A deviation that grows by 10 N/m along x.
double ramp_N(const Vector3d& position_W) { return 0.1 + 10.0 * position_W.x(); }

TEST(UncertaintyLine, IsExactAlongTheMotionAndNoLessBesideIt) {
  ToolMotion motion;
  for (int i = 0; i <= 100; ++i) {
    motion.observe(0.002 * i, Vector3d(0.0004 * i - 0.04, 0.0, 0.0));  // 0.2 m/s
  }
  UncertaintyLine line;
  line.update(motion.position_W(), motion, ramp_N);
  EXPECT_NEAR(line.at_N(Vector3d::Zero(), 0.0), 0.1, 1e-9);
  EXPECT_NEAR(line.at_N(Vector3d(0.004, 0.0, 0.0), 0.0), 0.14, 1e-9);
  EXPECT_NEAR(line.at_N(Vector3d(0.0, 0.003, 0.004), 0.0), 0.15, 1e-9);
  EXPECT_EQ(line.at_N(Vector3d(-0.01, 0.0, 0.0), 0.02), 0.02) << "the least";
}

TEST(UncertaintyLine, GrowsInAllDirectionsFromAToolAtRest) {
  ToolMotion motion;
  motion.observe(0.0, Vector3d::Zero());
  UncertaintyLine line;
  line.update(Vector3d::Zero(), motion, ramp_N);
  EXPECT_NEAR(line.at_N(Vector3d(-0.002, 0.0, 0.0), 0.0), 0.12, 1e-9);
  EXPECT_NEAR(line.at_N(Vector3d(0.0, 0.002, 0.0), 0.0), 0.12, 1e-9);
}

TEST(FieldRendering, AnswersWithoutAFieldWhereNothingIsTouched) {
  FieldRendering rendering;
  ContactState contact;
  ForceEstimate estimate;
  EXPECT_TRUE(rendering.answers_without_field(0.0, Vector3d::Zero(), contact, estimate));
  EXPECT_EQ(estimate.status, EstimateStatus::kUnknown);
  contact.lost();
  EXPECT_TRUE(rendering.answers_without_field(0.0, Vector3d::Zero(), contact, estimate));
  EXPECT_EQ(estimate.status, EstimateStatus::kOk);
  EXPECT_EQ(estimate.uncertainty_N, 0.0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(rendering.answers_without_field(nan, Vector3d::Zero(), contact, estimate));
  EXPECT_EQ(estimate.status, EstimateStatus::kNotFinite);
  contact.made(0.0);
  EXPECT_TRUE(rendering.answers_without_field(0.0, Vector3d::Zero(), contact, estimate));
  contact.set_origin(Vector3d::Zero());
  EXPECT_FALSE(rendering.answers_without_field(0.0, Vector3d::Zero(), contact, estimate));
}

TEST(FieldRendering, FadesBetweenTwoAndThreeLengthsFromTheSamples) {
  const auto field = make_dictionary_field(field_settings({}));
  Observation o;
  o.force_N = Vector3d(1.0, 0.0, 0.0);
  field->take(o);
  ContactState contact;
  contact.made(0.0);
  contact.set_origin(Vector3d::Zero());
  const FieldRendering rendering;
  const auto render = [&](double x_m) {
    ForceEstimate estimate;
    rendering.render(*field, History::Zero(), Vector3d(x_m, 0.0, 0.0), contact, Vector3d::Zero(),
                     0.0, estimate);
    return estimate;
  };
  const auto field_N = [&](double x_m) {
    return field->read(Vector3d(x_m, 0.0, 0.0), History::Zero()).force_N.x();
  };
  EXPECT_EQ(render(0.05).force_W.x(), field_N(0.05));
  EXPECT_NEAR(render(0.075).force_W.x(), 0.5 * field_N(0.075), 1e-6);
  EXPECT_EQ(render(0.0901).status, EstimateStatus::kUnknown);
  EXPECT_EQ(render(0.0901).force_W, Vector3d::Zero());
}

}  // namespace
}  // namespace forcegrid::kriging
