// SPDX-License-Identifier: Apache-2.0
#include "text/nearest_name.h"

#include <gtest/gtest.h>

namespace forcegrid::text {
namespace {

TEST(NearestName, CountsSwappedNeighboursAsOneEdit) {
  EXPECT_EQ(nearest_name("sceen", {"scene", "screen"}), "scene");
  EXPECT_EQ(nearest_name("rtae", {"gate", "rate", "table"}), "rate");
  EXPECT_EQ(nearest_name("cels", {"scale", "cells", "hold"}), "cells");
  EXPECT_EQ(nearest_name("x", {}), "");
}

}  // namespace
}  // namespace forcegrid::text
