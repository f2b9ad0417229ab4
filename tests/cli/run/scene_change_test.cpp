// SPDX-License-Identifier: Apache-2.0
#include "cli/run/scene_change.h"

#include <gtest/gtest.h>

namespace forcegrid::cli {
namespace {

// A page may change from a scene of finite elements to one of springs, which has no cheaper model.
TEST(SceneChange, AnotherSceneIsSimulatedAsWritten) {
  RunOptions options;
  options.scene = "liver";
  options.material_tolerance_percent = 10.0;
  options.open_view = true;
  options.rate_Hz = 1000.0;
  const RunOptions next = with_scene(options, "small");
  EXPECT_EQ(next.scene, "small");
  EXPECT_FALSE(next.material_tolerance_percent.has_value());
  EXPECT_FALSE(next.open_view);
  EXPECT_EQ(next.rate_Hz, 1000.0);
}

}  // namespace
}  // namespace forcegrid::cli
