// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/field_requests.h"

#include <gtest/gtest.h>

#include <vector>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

double unknown_N(const Vector3d& /*position_W*/) { return 1.0; }
double known_N(const Vector3d& /*position_W*/) { return FieldRequests::kAsk_N; }
double known_before_N(const Vector3d& /*position_W*/) { return FieldRequests::kAskBefore_N; }

TEST(FieldRequests, AskNothingWhereTheFieldKnowsEnough) {
  FieldRequests requests;
  Vector3d wanted_W = Vector3d::Ones();
  EXPECT_FALSE(requests.plan(0.0, Vector3d::Zero(), Vector3d::Zero(), {}, known_N, wanted_W));
  EXPECT_FALSE(requests.plan_before_contact(0.0, Vector3d::Zero(), known_before_N, wanted_W));
  EXPECT_EQ(wanted_W, Vector3d::Ones());
}

TEST(FieldRequests, AskAheadOfAMovingTool) {
  ToolMotion motion;
  for (int i = 0; i <= 100; ++i) {
    motion.observe(0.002 * i, Vector3d(0.0002 * i - 0.02, 0.0, 0.0));  // 0.1 m/s
  }
  FieldRequests requests;
  Vector3d wanted_W;
  ASSERT_TRUE(requests.plan(0.0, Vector3d::Zero(), Vector3d::Zero(), motion, unknown_N, wanted_W));
  EXPECT_NEAR(wanted_W.x(), 0.1 / 30.0, 1e-6) << "a sample period ahead";
  EXPECT_NEAR(wanted_W.tail<2>().norm(), 0.0, 1e-12);
}

TEST(FieldRequests, AskBesideAToolAtRestInAllDirectionsAndNotTwice) {
  FieldRequests requests;
  std::vector<Vector3d> asked;
  for (int i = 0; i < 12; ++i) {
    Vector3d wanted_W;
    if (requests.plan(0.001 * i, Vector3d::Zero(), Vector3d::Zero(), {}, unknown_N, wanted_W)) {
      EXPECT_NEAR(wanted_W.norm(), FieldRequests::kBeside_m, 1e-12);
      asked.push_back(wanted_W);
    }
  }
  EXPECT_EQ(asked.size(), 6u);
  Vector3d wanted_W;
  EXPECT_TRUE(requests.plan(0.4, Vector3d::Zero(), Vector3d::Zero(), {}, unknown_N, wanted_W))
      << "after 0.3 s once more";
}

TEST(FieldRequests, AskAtPointsOfALattice) {
  FieldRequests requests;
  requests.ask_on_lattice(Vector3d::Constant(-0.1), 0.004);
  const Vector3d origin_W(0.0505, 0.0, 0.0);
  Vector3d wanted_W;
  ASSERT_TRUE(requests.plan(0.0, origin_W, origin_W, {}, unknown_N, wanted_W));
  const Vector3d index = (wanted_W - origin_W + Vector3d::Constant(0.1)) / 0.004;
  EXPECT_LT((index - index.array().round().matrix()).norm(), 1e-9);
}

TEST(FieldRequests, AskThirteenPointsBeforeAContact) {
  FieldRequests requests;
  int asked = 0;
  Vector3d wanted_W;
  while (requests.plan_before_contact(0.0, Vector3d::Zero(), unknown_N, wanted_W)) {
    EXPECT_LT(wanted_W.norm(), 0.019);
    ++asked;
  }
  EXPECT_EQ(asked, 13);
  requests.begin_contact();
  EXPECT_TRUE(requests.plan_before_contact(0.0, Vector3d::Zero(), unknown_N, wanted_W));
}

}  // namespace
}  // namespace forcegrid::kriging
