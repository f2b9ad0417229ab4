// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "forcegrid/methods.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;

MethodOptions small_grid() {
  MethodOptions options;
  options.grid.min_W = Vector3d(-0.05, -0.05, -0.05);
  options.grid.max_W = Vector3d(0.05, 0.05, 0.05);
  options.grid.cells = Eigen::Vector3i(10, 10, 10);
  options.influence_radius_m = 0.03;
  return options;
}

Sample sample_at(const Vector3d& position_W, const Vector3d& force_W, double time_s) {
  Sample sample;
  sample.position_W = position_W;
  sample.force_W = force_W;
  sample.time_s = time_s;
  return sample;
}

TEST(ForceMethods, RefuseAnUnknownNameAndListTheKnownOnes) {
  try {
    make_force_method("forcgrid", small_grid());
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("forcgrid"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("known methods: auto, forcegrid, "),
              std::string::npos);
  }
}

TEST(ForceMethods, KnowNothingThenNothingInFreeSpaceThenWhatTheyWereTold) {
  for (const std::string& name : method_names()) {
    SCOPED_TRACE(name);
    const auto method = make_force_method(name, small_grid());
    EXPECT_EQ(method->name(), name);
    EXPECT_EQ(method->force(0.0, Vector3d::Zero()).status, EstimateStatus::kUnknown);
    method->contact_lost();
    EXPECT_EQ(method->force(0.0, Vector3d::Zero()).status, EstimateStatus::kOk);
    EXPECT_EQ(method->force(0.0, Vector3d::Zero()).force_W, Vector3d::Zero());
    method->contact_made(1, Vector3d::Zero());
    EXPECT_EQ(method->force(0.0, Vector3d::Zero()).status, EstimateStatus::kUnknown);
    Sample sample = sample_at(Vector3d::Zero(), Vector3d(1, 2, 3), 0.1);
    sample.has_stiffness = true;  // zero; some methods need one
    method->take_sample(sample);
    while (method->work(64) > 0) {
    }
    const ForceEstimate estimate = method->force(0.2, Vector3d(0.001, 0.0, 0.0));
    // Kriging without stiffness can't know the force a millimetre away; all kriging keeps from one
    // contact to the next what it has learnt.
    const bool kriging = name == "auto" || name.find("kriging") != std::string::npos;
    const bool unsure =
        kriging && name != "kriging-tangent" && name != "kriging-bank" && name != "auto";
    EXPECT_EQ(estimate.status, unsure ? EstimateStatus::kPartlyKnown : EstimateStatus::kOk);
    EXPECT_LT(
        (estimate.force_W - Vector3d(1, 2, 3)).norm(),
        kriging || name == "forcegrid-mls" ? 0.01 : 1e-6);  // the fit's ridge, in single precision
    EXPECT_EQ(std::isnan(estimate.uncertainty_N), !kriging);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(method->force(0.2, Vector3d(nan, 0, 0)).status, EstimateStatus::kNotFinite);
    EXPECT_EQ(method->force(nan, Vector3d::Zero()).status, EstimateStatus::kNotFinite);
    // A new contact forgets the old one, an end of contact is free space.
    method->contact_made(2, Vector3d::Zero());
    EXPECT_EQ(method->force(0.3, Vector3d::Zero()).status,
              kriging ? EstimateStatus::kPartlyKnown : EstimateStatus::kUnknown);
    method->contact_lost();
    EXPECT_EQ(method->force(0.3, Vector3d::Zero()).force_W, Vector3d::Zero());
  }
}

TEST(ForceMethods, IgnoreSamplesThatAreNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const std::string& name : method_names()) {
    SCOPED_TRACE(name);
    const auto method = make_force_method(name, small_grid());
    method->contact_made(1, Vector3d::Zero());
    method->take_sample(sample_at(Vector3d::Zero(), Vector3d(nan, 0, 0), 0.1));
    method->take_sample(sample_at(Vector3d::Zero(), Vector3d(1, 0, 0), nan));
    while (method->work(64) > 0) {
    }
    EXPECT_EQ(method->force(0.2, Vector3d::Zero()).status, EstimateStatus::kUnknown);
  }
}

TEST(HoldMethod, IgnoresALateSample) {
  const auto method = make_force_method("hold", small_grid());
  method->contact_made(1, Vector3d::Zero());
  method->take_sample(sample_at(Vector3d::Zero(), Vector3d(2, 0, 0), 0.2));
  method->take_sample(sample_at(Vector3d::Zero(), Vector3d(1, 0, 0), 0.1));
  EXPECT_EQ(method->force(0.3, Vector3d::Zero()).force_W, Vector3d(2, 0, 0));
}

}  // namespace
}  // namespace forcegrid
