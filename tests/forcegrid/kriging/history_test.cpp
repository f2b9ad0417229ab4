// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/history.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace forcegrid {
namespace {

using Eigen::Vector3d;

constexpr ToolHistory::TimeConstants kTau_s = {0.01, 0.1, 1.0, 0.005, 0.03, 0.2};
constexpr double kRate_Hz = 500.0;
constexpr double kTolerance_m = 5e-8;  // linear between entries: v/tau (2 ms)^2 / 8 = 3e-8

TEST(ToolHistory, LagsOnAStraightPathAsTheFiltersDoInClosedForm) {
  ToolHistory history(kTau_s);
  const Vector3d velocity(0.05, -0.02, 0.01);
  for (int i = 0; i <= 300; ++i) {
    history.observe(1.0 + i / kRate_Hz, i / kRate_Hz * velocity);
  }
  for (const double age_s : {0.0, 0.0333, 0.1004, 0.5}) {
    ToolHistory::Lags lags;
    ASSERT_TRUE(history.find(1.6 - age_s, lags));
    for (int j = 0; j < ToolHistory::kLags; ++j) {
      const double tau_s = kTau_s[static_cast<std::size_t>(j)];
      const Vector3d expected = tau_s * velocity * (1.0 - std::exp(-(0.6 - age_s) / tau_s));
      EXPECT_LT((lags.col(j).cast<double>() - expected).norm(), kTolerance_m)
          << "lag " << j << ", " << age_s << " s ago";
    }
  }
}

TEST(ToolHistory, KnowsAboutTheLastSecondAtAnyRate) {
  for (const double rate_Hz : {500.0, 1000.0, 4000.0}) {
    ToolHistory history(kTau_s);
    for (int i = 0; i < static_cast<int>(3.0 * rate_Hz); ++i) {
      history.observe(i / rate_Hz, Vector3d::Zero());
    }
    const double newest_s = (std::floor(3.0 * rate_Hz) - 1.0) / rate_Hz;
    ToolHistory::Lags lags;
    EXPECT_TRUE(history.find(newest_s, lags));
    EXPECT_TRUE(history.find(newest_s - 1.0, lags)) << rate_Hz;
    EXPECT_FALSE(history.find(newest_s + 1e-6, lags)) << "the future is not known";
    EXPECT_FALSE(history.find(newest_s - 2.9, lags));
  }
}

TEST(ToolHistory, KnowsNothingBeforeTheFirstObservationAndIgnoresWhatIsNotFinite) {
  ToolHistory history(kTau_s);
  ToolHistory::Lags lags;
  EXPECT_TRUE(history.empty());
  EXPECT_FALSE(history.find(0.0, lags));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  history.observe(nan, Vector3d::Zero());
  history.observe(0.0, Vector3d(0.0, nan, 0.0));
  EXPECT_TRUE(history.empty());
}

TEST(ToolHistory, StartsAnewAfterAGap) {
  ToolHistory history(kTau_s);
  for (int i = 0; i < 50; ++i) {
    history.observe(i / kRate_Hz, i * Vector3d(0.001, 0, 0));
  }
  EXPECT_GT(history.now().norm(), 0.01F);
  history.observe(1.0, Vector3d(0.5, 0, 0));
  EXPECT_EQ(history.now().norm(), 0.0F);
  ToolHistory::Lags lags;
  EXPECT_FALSE(history.find(0.05, lags));
}

}  // namespace
}  // namespace forcegrid
