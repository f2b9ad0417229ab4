// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/virtual_coupling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

constexpr double kCycle_s = 0.002;

TEST(VirtualCoupling, IsASpringInSeriesWithTheObject) {
  for (const double stiffness_N_per_m : {50.0, 300.0, 2000.0}) {
    const CouplingOptions options{.stiffness_N_per_m = 1000.0, .damping_N_s_per_m = 10.0};
    VirtualCoupling coupling(options);
    const Vector3d tool_W(0.004, -0.003, 0.001);
    Vector3d force_W = Vector3d::Zero();
    for (int i = 0; i < 500; ++i) {
      force_W = -stiffness_N_per_m * coupling.proxy_W(tool_W);
      coupling.advance(kCycle_s, force_W);
    }
    const double felt_N_per_m = stiffness_N_per_m * 1000.0 / (stiffness_N_per_m + 1000.0);
    EXPECT_LT((force_W + felt_N_per_m * tool_W).norm(), 1e-9) << stiffness_N_per_m;
  }
}

TEST(VirtualCoupling, ApproachesRestAsItsTimeConstantSays) {
  VirtualCoupling coupling({.stiffness_N_per_m = 500.0, .damping_N_s_per_m = 5.0});
  constexpr double kStep_s = 1e-5;  // backward Euler is of first order
  for (int i = 0; i < 1000; ++i) {  // 10 ms, one time constant
    coupling.advance(kStep_s, Vector3d(0.0, 0.0, 1.0));
  }
  EXPECT_NEAR(coupling.proxy_W(Vector3d::Zero()).z(), 1.0 / 500.0 * (1.0 - std::exp(-1.0)), 1e-6);
  coupling.reset();
  EXPECT_EQ(coupling.proxy_W(Vector3d::Zero()), Vector3d::Zero());
}

TEST(VirtualCoupling, IgnoresWhatIsNotANumber) {
  VirtualCoupling coupling;
  coupling.advance(kCycle_s, Vector3d(0.0, std::numeric_limits<double>::quiet_NaN(), 0.0));
  coupling.advance(std::numeric_limits<double>::infinity(), Vector3d::UnitX());
  coupling.advance(0.0, Vector3d::UnitX());
  EXPECT_EQ(coupling.proxy_W(Vector3d::Zero()), Vector3d::Zero());
}

TEST(VirtualCoupling, RefusesWhatIsNoSpringOrDamper) {
  EXPECT_THROW(VirtualCoupling({.stiffness_N_per_m = 0.0}), std::invalid_argument);
  EXPECT_THROW(VirtualCoupling({.damping_N_s_per_m = -1.0}), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::servo
