// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/method_variant.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "forcegrid/core/method_options.h"

namespace forcegrid {
namespace {

MethodOptions base() {
  MethodOptions options;
  options.grid.min_W = Eigen::Vector3d::Zero();
  options.grid.max_W = Eigen::Vector3d(0.16, 0.12, 0.12);
  options.grid.cells = Eigen::Vector3i(49, 49, 49);
  return options;
}

std::string refusal(const std::string& text) {
  try {
    parse_method_variant(text, base());
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(MethodVariant, IsANameWithChangesToTheOptions) {
  const MethodVariant variant = parse_method_variant(
      "  forcegrid unit=m  r=13mm s=3 weight=idw6 read=tricubic storage=blocks cells=40,30,20 "
      "ridge=1e-3 "
      "nug=1e-6",
      base());
  EXPECT_EQ(variant.name, "forcegrid");
  EXPECT_EQ(variant.text,
            "forcegrid unit=m r=13mm s=3 weight=idw6 read=tricubic storage=blocks cells=40,30,20 "
            "ridge=1e-3 nug=1e-6");
  EXPECT_EQ(variant.options.unit_m, 1.0);
  EXPECT_DOUBLE_EQ(variant.options.influence_radius(), 0.013);
  EXPECT_EQ(variant.options.samples_per_cell, 3);
  EXPECT_EQ(variant.options.weight, WeightKind::kInverse6);
  EXPECT_EQ(variant.options.interpolation, Interpolation::kTricubic);
  EXPECT_EQ(variant.options.storage, GridStorage::kBlocks);
  EXPECT_EQ(variant.options.grid.cells, Eigen::Vector3i(40, 30, 20));
  EXPECT_EQ(variant.options.ridge, 1e-3);
  EXPECT_EQ(variant.options.nugget, 1e-6);
}

TEST(MethodVariant, LeavesTheBaseAloneWhereItSaysNothing) {
  const MethodVariant variant = parse_method_variant("hold", base());
  EXPECT_EQ(variant.options.unit_m, 1e-3);
  EXPECT_DOUBLE_EQ(variant.options.influence_radius(), 0.16 / 6);
  EXPECT_FALSE(variant.options.weight.has_value());
  EXPECT_EQ(parse_method_variant("forcegrid cells=400", base()).options.grid.cells,
            Eigen::Vector3i(400, 400, 400));
  EXPECT_NEAR(parse_method_variant("forcegrid unit=cells", base()).options.unit_m,
              std::cbrt(0.16 * 0.12 * 0.12) / 49, 1e-15);
}

TEST(MethodVariant, NamesTheWordThatItCanNotUse) {
  EXPECT_NE(refusal("").find("no name"), std::string::npos);
  EXPECT_NE(refusal("forcgrid").find("'forcgrid' is not known; known methods: "),
            std::string::npos);
  EXPECT_NE(refusal("forcegrid unit").find("'unit': has no value"), std::string::npos);
  EXPECT_NE(refusal("forcegrid r=20").find("give a length with its unit"), std::string::npos);
  EXPECT_NE(refusal("forcegrid r=-2mm").find("above zero"), std::string::npos);
  EXPECT_NE(refusal("forcegrid r=nanmm").find("not a number"), std::string::npos);
  EXPECT_NE(refusal("forcegrid s=1.5").find("whole number"), std::string::npos);
  EXPECT_NE(refusal("forcegrid weight=tent").find("paper, idw4, idw6"), std::string::npos);
  EXPECT_NE(refusal("forcegrid cells=1,2").find("one number, or three"), std::string::npos);
  EXPECT_NE(refusal("forcegrid nug=0").find("above zero"), std::string::npos);
  EXPECT_NE(refusal("forcegrid nug=1e-5x").find("after the number"), std::string::npos);
  EXPECT_NE(refusal("forcegrid colour=red").find("known keys are unit, r, s"), std::string::npos);
}

}  // namespace
}  // namespace forcegrid
