#include <gtest/gtest.h>

#include "simulator/elastic_object.h"
#include "simulator/scene.h"
#include "tests/support/allocation_count.h"

namespace forcegrid::simulator {
namespace {

TEST(ElasticObject, MovesDoNotAllocateEvenWhenTheObjectSnapsThrough) {
  ElasticObject<float> object(make_scene("small").mesh);
  object.grab(Eigen::Vector3d::Zero(), 0.012);
  bool left_branch = false;
  const testing::AllocationCount count;
  for (int i = 1; i <= 40; ++i) {
    left_branch |= object.move_to({0.0002 * i, 0, -0.001 * i}).left_branch;
  }
  EXPECT_EQ(count.value(), 0U);
  EXPECT_TRUE(left_branch) << "the way out of an unstable state was not exercised";
}

TEST(ElasticObject, TheCountSeesTheAllocationsOfPositions) {
  ElasticObject<float> object(make_scene("small").mesh);
  const testing::AllocationCount count;
  EXPECT_FALSE(object.positions_W().empty());
  EXPECT_GT(count.value(), 0U);
}

}  // namespace
}  // namespace forcegrid::simulator
