// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/core/storage_blocks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;

constexpr double kRounding_m = 1e-12;

// A box of 10 cm with vertices 2.5 mm apart: a block is 2 cm wide.
std::unique_ptr<ForceMethod> make(const char* text) {
  MethodOptions options;
  options.grid.min_W = Vector3d::Constant(-0.05);
  options.grid.max_W = Vector3d::Constant(0.05);
  options.grid.cells.setConstant(40);
  options.influence_radius_m = 0.006;
  const MethodVariant variant = parse_method_variant(text, options);
  return make_force_method(variant.name, variant.options);
}

void show(ForceMethod& method, double time_s, const Vector3d& position_W) {
  Sample sample;
  sample.time_s = time_s;
  sample.position_W = position_W;
  sample.force_W = Vector3d(0.0, 0.0, 1.0);
  sample.contact_epoch = 1;
  method.observe(time_s, position_W);
  method.take_sample(sample);
  while (method.work(1000) > 0) {
  }
}

std::vector<StorageBlock> blocks_of(const ForceMethod& method) {
  std::vector<StorageBlock> blocks(500);
  blocks.resize(dynamic_cast<const StorageBlocks&>(method).storage_blocks(blocks));
  return blocks;
}

bool has(const std::vector<StorageBlock>& blocks, const Vector3d& low_W, const Vector3d& high_W) {
  return std::any_of(blocks.begin(), blocks.end(), [&](const StorageBlock& block) {
    return (block.low_W - low_W).norm() < kRounding_m &&
           (block.high_W - high_W).norm() < kRounding_m;
  });
}

TEST(StorageBlocks, AreThoseThatASampleReaches) {
  const auto method = make("forcegrid storage=blocks");
  EXPECT_TRUE(blocks_of(*method).empty());
  method->contact_made(1, Vector3d::Zero());
  show(*method, 1.0, Vector3d(-0.04, -0.04, -0.04));  // 4 vertices from the corner, reaches 2.4
  ASSERT_EQ(blocks_of(*method).size(), 1U);
  EXPECT_TRUE(has(blocks_of(*method), Vector3d::Constant(-0.05), Vector3d::Constant(-0.03)));
  show(*method, 2.0, Vector3d(-0.03, -0.04, -0.04));  // on the first vertex of the next along x
  ASSERT_EQ(blocks_of(*method).size(), 2U);
  EXPECT_TRUE(has(blocks_of(*method), {-0.03, -0.05, -0.05}, {-0.01, -0.03, -0.03}));
  show(*method, 3.0, Vector3d(-0.04, -0.04, 0.02));  // 28 vertices up: the fourth along z
  ASSERT_EQ(blocks_of(*method).size(), 3U);
  EXPECT_TRUE(has(blocks_of(*method), {-0.05, -0.05, 0.01}, {-0.03, -0.03, 0.03}));
  method->contact_made(2, Vector3d::Zero());
  EXPECT_TRUE(blocks_of(*method).empty()) << "a new contact begins on an empty grid";
}

TEST(StorageBlocks, EndWithTheGrid) {
  const auto method = make("forcegrid storage=blocks");
  method->contact_made(1, Vector3d::Zero());
  show(*method, 1.0, Vector3d::Constant(0.05));  // vertex 40 of 40: one layer is in a block alone
  const auto blocks = blocks_of(*method);
  ASSERT_EQ(blocks.size(), 8U);
  EXPECT_TRUE(has(blocks, Vector3d::Constant(0.03), Vector3d::Constant(0.05)));
  EXPECT_TRUE(has(blocks, Vector3d::Constant(0.05), Vector3d::Constant(0.05)));
}

TEST(StorageBlocks, AreCountedWhereThereIsNoRoomForThem) {
  const auto method = make("forcegrid storage=blocks");
  method->contact_made(1, Vector3d::Zero());
  show(*method, 1.0, Vector3d::Constant(0.05));
  std::array<StorageBlock, 3> few;
  EXPECT_EQ(dynamic_cast<const StorageBlocks&>(*method).storage_blocks(few), 8U);
  for (const StorageBlock& block : few) {
    EXPECT_GT(block.low_W.minCoeff(), 0.029);
  }
  EXPECT_EQ(dynamic_cast<const StorageBlocks&>(*method).storage_blocks({}), 8U);
}

TEST(StorageBlocks, OfAnAdaptiveGridAreTheCubeAroundTheTool) {
  const auto method = make("forcegrid storage=adaptive");
  method->contact_made(1, Vector3d::Zero());
  show(*method, 1.0, Vector3d::Zero());
  const auto blocks = blocks_of(*method);
  EXPECT_EQ(blocks.size(), 64U);  // 4 x 4 x 4
  for (const StorageBlock& block : blocks) {
    EXPECT_NEAR((block.high_W - block.low_W).maxCoeff(), 0.02, kRounding_m);
  }
  EXPECT_TRUE(has(blocks, Vector3d::Constant(-0.01), Vector3d::Constant(0.01)));
}

TEST(StorageBlocks, OfADenseGridAreNone) {
  const auto method = make("forcegrid");
  method->contact_made(1, Vector3d::Zero());
  show(*method, 1.0, Vector3d::Zero());
  EXPECT_TRUE(blocks_of(*method).empty());
}

TEST(StorageBlocks, OfForcegridKrigingAreRelativeToTheContactPoint) {
  const auto method = make("forcegrid-kriging");
  EXPECT_TRUE(blocks_of(*method).empty());
  const Vector3d contact_W(0.011, -0.007, 0.003);
  method->contact_made(1, contact_W);
  for (int i = 0; i < 10; ++i) {
    show(*method, 0.03 * i, contact_W - Vector3d(0.0, 0.0, 0.0005 * i));
  }
  const auto blocks = blocks_of(*method);
  ASSERT_FALSE(blocks.empty());
  const bool around_the_tool = std::any_of(blocks.begin(), blocks.end(), [&](const auto& block) {
    const Vector3d tool_W = contact_W - Vector3d(0.0, 0.0, 0.004);
    return (tool_W.array() >= block.low_W.array()).all() &&
           (tool_W.array() <= block.high_W.array()).all();
  });
  EXPECT_TRUE(around_the_tool);
  // Its vertices are 4 mm apart, and one of them is the contact point.
  const Vector3d steps = (blocks.front().low_W - contact_W) / 0.004;
  EXPECT_LT((steps - steps.array().round().matrix()).norm(), 1e-9);
}

}  // namespace
}  // namespace forcegrid
