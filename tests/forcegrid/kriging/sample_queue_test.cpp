// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/sample_queue.h"

#include <gtest/gtest.h>

#include <limits>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

const Vector3d kOrigin_W(0.1, 0.2, 0.3);

class SampleQueueTest : public ::testing::Test {
 protected:
  SampleQueueTest() {
    contact_.made(0.0);
    contact_.set_origin(kOrigin_W);
    sample_.time_s = 1.0;
    sample_.position_W = kOrigin_W + Vector3d(0.001, 0.0, 0.0);
    sample_.contact_point_W = kOrigin_W + Vector3d(0.0, 0.01, 0.0);
    sample_.force_W = Vector3d(1.0, 2.0, 3.0);
  }
  const QueuedSample& push() {
    queue_.push(sample_, contact_, motion_);
    return queue_.at(queue_.taken() - 1);
  }

  SampleQueue queue_;
  ContactState contact_;
  ToolMotion motion_;
  Sample sample_;
};

TEST_F(SampleQueueTest, MakesPositionsRelativeToTheContact) {
  const QueuedSample& queued = push();
  EXPECT_LT((queued.observation.position_m - Vector3d(0.001, 0.0, 0.0)).norm(), 1e-15);
  EXPECT_EQ(queued.observation.force_N, sample_.force_W);
  EXPECT_EQ(queued.observation.contact, contact_.number());
  EXPECT_EQ(queue_.newest_W(), sample_.position_W);
}

TEST_F(SampleQueueTest, RefusesWhatIsLateOrNotFiniteOrOutOfContact) {
  push();
  EXPECT_TRUE(queue_.accepts(sample_, contact_, false)) << "the same time once more";
  sample_.time_s = 0.9;
  EXPECT_FALSE(queue_.accepts(sample_, contact_, false));
  sample_.from_query = true;
  EXPECT_TRUE(queue_.accepts(sample_, contact_, false)) << "answers come in any order";
  sample_.force_W.x() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(queue_.accepts(sample_, contact_, false));
  sample_.force_W.x() = 0.0;
  contact_.lost();
  EXPECT_FALSE(queue_.accepts(sample_, contact_, false));
}

TEST_F(SampleQueueTest, TakesAnswersAboutAnExpectedContactForThoseWhoUseThem) {
  contact_.lost();
  contact_.expect(0.0, kOrigin_W);
  sample_.from_query = sample_.before_contact = true;
  EXPECT_FALSE(queue_.accepts(sample_, contact_, false));
  EXPECT_TRUE(queue_.accepts(sample_, contact_, true));
  const QueuedSample& queued = push();
  EXPECT_TRUE(queued.before_contact);
  EXPECT_EQ(queued.observation.origin_W, sample_.contact_point_W);
  sample_.contact_point_W.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(queue_.accepts(sample_, contact_, true)) << "of no place";
}

TEST_F(SampleQueueTest, SaysHowTheForceHasRisenSinceTheSampleBefore) {
  EXPECT_FALSE(push().observation.has_rise);
  sample_.time_s += 1.0 / 30.0;
  sample_.force_W.x() += 0.5;
  EXPECT_TRUE(push().observation.has_rise);
  EXPECT_NEAR(queue_.at(1).observation.rise_N.x(), 0.5, 1e-12);
  sample_.time_s += 2.0 / 30.0;
  EXPECT_FALSE(push().observation.has_rise) << "one was lost in between";
  queue_.begin_contact();
  sample_.time_s += 1.0 / 30.0;
  EXPECT_FALSE(push().observation.has_rise) << "another contact";
  EXPECT_EQ(queue_.first_of_contact(), 3u);
}

TEST_F(SampleQueueTest, KnowsASimulatorThatHasNotConverged) {
  EXPECT_FALSE(push().observation.unfinished);
  sample_.relative_residual = 0.02;
  EXPECT_TRUE(push().observation.unfinished);
  sample_.relative_residual = 0.0;
  sample_.converged = false;
  EXPECT_TRUE(push().observation.unfinished);
}

TEST_F(SampleQueueTest, MakesAStiffnessSymmetricAndLeavesOutOneThatIsNotFinite) {
  sample_.has_stiffness = true;
  sample_.stiffness_W << 1, 2, 3, 4, 5, 6, 7, 8, 9;
  const Observation& o = push().observation;
  ASSERT_TRUE(o.has_stiffness);
  for (int i = 0; i < 6; ++i) {
    const int r = kStiffnessRow[i];
    const int c = kStiffnessColumn[i];
    EXPECT_EQ(o.stiffness_N_per_m[i],
              0.5 * (sample_.stiffness_W(r, c) + sample_.stiffness_W(c, r)));
  }
  sample_.stiffness_W(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(push().observation.has_stiffness);
}

}  // namespace
}  // namespace forcegrid::kriging
