// SPDX-License-Identifier: Apache-2.0
// `forcegrid chart wrist` as its user starts it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/command_test.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::text_of;

class ChartWristCommand : public testing::CommandTest {
 protected:
  ChartWristCommand() : CommandTest(std::chrono::seconds(100)) {}
};

TEST_F(ChartWristCommand, MeasuresTheMotionsThatAreAskedFor) {
  const std::string out = fresh_folder("chart_wrist");
  ASSERT_EQ(run({"chart", "wrist", "--quick", "--motions", "twist,tilt", "--simulator-rate", "60",
                 "--out", out}),
            0)
      << error_;
  EXPECT_THAT(out_, HasSubstr("Open " + out + "/wrist.svg"));
  const json rows = json::parse(text_of(out + "/wrist.json")).at("rows");
  ASSERT_EQ(rows.size(), 2U);
  for (const json& row : rows) {
    EXPECT_LT(row.at("stiffness_error_rms_percent"), row.at("held_error_rms_percent"));
    EXPECT_TRUE(
        std::filesystem::exists(out + "/wrist_" + row.at("motion").get<std::string>() + ".csv"));
  }
  EXPECT_TRUE(std::filesystem::exists(out + "/wrist.svg"));
}

TEST_F(ChartWristCommand, NamesTheKnownMotionsAndMethods) {
  const std::string out = fresh_folder("chart_wrist_words");
  const auto said = [&](const std::string& flag, const std::string& value) {
    EXPECT_NE(run({"chart", "wrist", "--out", out, flag, value}), 0) << value;
    return error_;
  };
  EXPECT_THAT(said("--motions", "wriggle"), HasSubstr("twist"));
  EXPECT_THAT(said("--method", "wishful"), HasSubstr("known methods"));
  EXPECT_THAT(said("--scene", "blok"), HasSubstr("block"));
}

}  // namespace
}  // namespace forcegrid
